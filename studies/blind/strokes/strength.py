"""The energy q of an effect on strokes, and the strength that gives a wanted q.

q is the energy of an effect that the base model cannot absorb, over the noise floor. It is measured in pairs: the same
commands are executed with and without the effect under the same random numbers, twice, in two realisations of
everything that differs between repeats. With `a` the coverage of a row's stroke without the effect,

    D_r = (after' − after) − (1 − a) (before' − before)          of realisation r, sRGB in [0, 1], whole windows

is the change of a prediction from `before` by the effect. A refit of the base would absorb one amplitude, one width,
one width in proportion to the press, one blur, one profile across the stroke and one extent of either end for the whole
world, fitted to D by least squares; R_r is the residual. An effect also moves strokes to other paper grain, which adds
noise that is independent between the two realisations, so that

    q = Σ ⟨R_1, R_2⟩ / Σ ½ ‖N‖²,   N = (after_1 − after_2) − (1 − a) (before_1 − before_2)  without the effect,

counts the systematic part only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.images import decode_png
from pentimento.studio.strokes.world import World
from studies.blind.strokes.collect import Recording, record_world
from studies.blind.strokes.design import Command, View
from studies.blind.strokes.paint_context import Disturbance, Mode
from studies.blind.strokes.worlds import Outside, Sketch
from studies.blind.truth import Strength, StrengthError

STRONGEST = 12.0
CEILING: dict[str | None, float] = {
    "vignetting": 3.0,  # beyond it the frame's corners are black
    "illumination_gradient": 4.0,  # the paper saturates the sensor
    "drying_shift": 3.0,  # the dry film scatters less than nothing
    "wet_mixing": 2.5,  # a stroke stirs more than all
    "canvas_tilt": 4.0,
}
"""Max strength that is still physical; `STRONGEST` for the other causes."""
TOLERANCE = 0.15  # relative, of q
EVALUATIONS = 5  # max number of strengths tried
REALISATIONS = (1, 2)  # 0 is recorded in the table
UNIT: dict[Mode, float] = {
    "width": 0.15,
    "amplitude": 0.4,
    "blur": 1.0,
    "tangential": 0.001,
    "normal": 0.001,
    "canvas_x": 0.001,
    "canvas_y": 0.001,
}
"""Amount of a disturbance of strength 1 at one standard deviation of its column (metres for shifts, else relative)."""
USUAL: dict[str | None, float] = {
    "bristle_lag": 0.035,
    "path_offset": 0.04,
    "path_scale": 0.04,
    "orientation_width": 0.02,
    "lens_distortion": 0.12,
    "backlash": 0.15,
    "latency": 0.3,
    "canvas_tilt": 0.25,
    "speed_width": 0.2,
    "speed_density": 0.7,
    "speed_bleed": 3.0,
    "tool_wear": 0.2,
    "ink_depletion": 0.22,
    "paper_bleed": 0.3,
    "curvature_width": 0.2,
    "wet_mixing": 0.3,
    "drying_shift": 2.0,
    "vignetting": 2.0,
    "illumination_gradient": 2.5,
    None: 0.2,
}
"""Start of the search for a strength: what typically gives START_Q. None: an outside effect."""
START_Q = 0.2
_HALOS_PX = (1.0, 2.0, 4.0)
_MODES = 8 + len(_HALOS_PX)
LARGEST_CHANGE = 0.8  # max relative decrease of a width, an amplitude or a blur

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trial:
    """A part of a world's design, recorded in both realisations without the effect."""

    sketch: Sketch
    commands: Sequence[Command]
    view: View
    column: FloatArray | None
    """[rows] standardised, of an outside effect."""
    sheets: tuple[int, ...]
    quiet: tuple[Recording, Recording]


def prepare_trial(sketch: Sketch, commands: Sequence[Command], view: View, column: FloatArray | None) -> Trial:
    """Record the sheets at a quarter and three quarters of the session, which represent its range of tool age."""
    last = commands[-1].sheet
    sheets = tuple(sorted({round(0.25 * last), round(0.75 * last)}))
    silent = sketch.with_strengths((0.0,) * len(sketch.causes))
    one, two = (
        _record(sketch, silent, commands, view=view, sheets=sheets, realisation=r, given=()) for r in REALISATIONS
    )
    return Trial(sketch, commands, view, column, sheets, (one, two))


def measure(trial: Trial, cause: str | None, strength: float) -> Strength:
    """q of one cause alone (None: the outside effect) at a strength."""
    sketch = trial.sketch
    given: list[Disturbance] = []
    world = sketch.world  # an outside effect is not part of the world
    if cause is None:
        assert sketch.outside is not None and trial.column is not None
        given = disturbances(sketch.outside, trial.column, strength)
    else:
        world = sketch.with_strengths(tuple(strength if c == cause else 0.0 for c in sketch.causes))
    loud = [
        _record(sketch, world, trial.commands, view=trial.view, sheets=trial.sheets, realisation=r, given=given)
        for r in REALISATIONS
    ]
    return Strength(strength, *_energy_over_floor(trial.quiet, (loud[0], loud[1])))


def find_strength(trial: Trial, cause: str | None, q: float) -> Strength:
    """The strength at which the effect has the wanted q within about 15 %, by the secant method on logarithms.

    Raises StrengthError where the max strength stays below.
    """
    strongest = CEILING.get(cause, STRONGEST)
    tried = [measure(trial, cause, min(USUAL[cause] * float(np.sqrt(q / START_Q)), strongest))]
    while len(tried) < EVALUATIONS and abs(tried[-1].q / q - 1) > TOLERANCE:
        guess = _secant(tried, q)
        if guess > strongest:
            if tried[-1].strength >= strongest:
                raise StrengthError(
                    f"{cause or trial.sketch.outside} reaches q = {tried[-1].q:.3f} with the {trial.sketch.tool.name} "
                    f"at strength {strongest} and not {q}; hide it in another world."
                )
            guess = strongest
        tried.append(measure(trial, cause, guess))
    best = min(tried, key=lambda t: abs(np.log(max(t.q, 1e-6) / q)))
    if not 0.5 < best.q / q < 2.0:
        raise StrengthError(
            f"No strength of {cause or trial.sketch.outside} was found that gives q = {q} with the "
            f"{trial.sketch.tool.name}: tried {[(round(t.strength, 3), round(t.q, 3)) for t in tried]}."
        )
    return best


def disturbances(outside: Outside, column: FloatArray, strength: float) -> list[Disturbance]:
    """One disturbance for each row of a standardised column: a saturating, slightly asymmetric dependence."""
    bent = np.tanh(0.7 * column + 0.15 * column**2) / 0.7
    amounts = strength * UNIT[outside.mode] * bent
    if outside.mode in ("width", "amplitude", "blur"):
        amounts = np.clip(amounts, -LARGEST_CHANGE, None)
    return [Disturbance(outside.mode, float(amount)) for amount in amounts]


def _secant(tried: list[Strength], q: float) -> float:
    """The next strength, from the power law through the two nearest trials, or a square law through one."""
    near = sorted(tried, key=lambda t: abs(np.log(max(t.q, 1e-4) / q)))
    s0, q0 = near[0].strength, max(near[0].q, 0.02 * q)
    power = 2.0
    if len(near) > 1 and near[1].q > 0 and near[1].strength != s0:
        power = float(np.clip(np.log(near[1].q / q0) / np.log(near[1].strength / s0), 1.0, 3.0))
    return s0 * float(np.clip((q / q0) ** (1 / power), 0.1, 6.0))


def _record(
    sketch: Sketch,
    world: World,
    commands: Sequence[Command],
    *,
    view: View,
    sheets: tuple[int, ...],
    realisation: int,
    given: Sequence[Disturbance],
) -> Recording:
    return record_world(
        world,
        sketch.seed,
        sketch.tool,
        palette_srgb=sketch.palette_srgb,
        commands=commands,
        view=view,
        disturbances=given,
        sheets=sheets,
        realisation=realisation,
    )


def _energy_over_floor(quiet: tuple[Recording, Recording], loud: tuple[Recording, Recording]) -> tuple[float, float]:
    """(q, its standard error)."""
    rows = len(quiet[0].rows)
    gram, moment = np.zeros((_MODES, _MODES)), np.zeros(_MODES)
    changes, modes, floor = [], [], np.empty(rows)
    press = np.array([-np.mean([p[3] for p in row["path"]]) for row in quiet[0].rows])
    press = (press - press.mean()) / max(press.std(), 1e-9)
    for k in range(rows):
        (before1, after1), (before2, after2) = ((_unit(r.before[k]), _unit(r.after[k])) for r in quiet)
        colour = np.asarray(quiet[0].rows[k]["color_srgb"])
        clear, basis = _base_modes(
            (before1 + before2) / 2, (after1 + after2) / 2, colour, float(press[k]), _path_px(quiet[0].rows[k])
        )
        noise = (after1 - after2) - clear * (before1 - before2)
        floor[k] = 0.5 * np.mean(noise**2)
        change = np.stack(
            [
                ((_unit(r.after[k]) - after) - clear * (_unit(r.before[k]) - before)).ravel()
                for r, before, after in zip(loud, (before1, before2), (after1, after2), strict=True)
            ]
        )  # [2, H W 3]
        gram += basis @ basis.T
        moment += basis @ change.mean(axis=0)
        changes.append(change)
        modes.append(basis)
    weights = np.linalg.lstsq(gram, moment, rcond=1e-9)[0]
    rest = [change - weights @ basis for change, basis in zip(changes, modes, strict=True)]
    energy = np.array([np.mean(one * two) for one, two in rest]) / floor.mean()
    return float(energy.mean()), float(energy.std() / np.sqrt(rows))


def _base_modes(
    before: FloatArray, after: FloatArray, colour_srgb: FloatArray, press: float, path_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Share of `before` that shows through [H, W, 1], and the base's modes [M, H W 3]: amplitude, width, blur, the
    last two in proportion to the press, a profile of free shape (how dark the rim is, and halos of several widths),
    extent of the start and of the end."""
    towards = colour_srgb - before  # [H, W, 3]
    length2 = (towards**2).sum(axis=2)
    cover = np.clip(((after - before) * towards).sum(axis=2) / np.maximum(length2, 0.01), 0.0, 1.0)
    down, right = np.gradient(cover)
    edge = np.hypot(down, right)
    bend = np.gradient(down, axis=0) + np.gradient(right, axis=1)
    ends = []
    for here, next_to in ((path_px[0], path_px[1]), (path_px[-1], path_px[-2])):
        outward = (here - next_to) / max(float(np.hypot(*(here - next_to))), 1e-9)
        column, row = np.meshgrid(np.arange(cover.shape[1]), np.arange(cover.shape[0]))
        beyond = (column - here[0]) * outward[0] + (row - here[1]) * outward[1]
        ends.append(-(right * outward[0] + down * outward[1]) * (beyond > 0))
    halos = [cv2.GaussianBlur(cover, (0, 0), width) - cover for width in _HALOS_PX]
    shapes = np.stack([cover, edge, press * edge, bend, press * bend, cover * (1 - cover), *halos, *ends])
    return 1 - cover[..., None], (shapes[..., None] * towards).reshape(_MODES, -1)


def _path_px(row: dict[str, Any]) -> FloatArray:
    """The commanded path in the window's pixels (column, row), [N, 2]."""
    path, (left, _, right, top) = np.asarray(row["path"], dtype=np.float64), row["window_m"]
    scale = decode_png(row["after"]["bytes"]).shape[1] / (right - left)
    return np.column_stack([(path[:, 1] - left) * scale - 0.5, (top - path[:, 2]) * scale - 0.5])


def _unit(image: NDArray[np.uint8]) -> FloatArray:
    return image.astype(np.float64) / 255
