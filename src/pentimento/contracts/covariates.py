"""Covariates with memory: the state that a stroke inherits from the strokes before it.

`advance` is pure. Collection, planning, synthesis and execution keep a `Memory` and compute from it, before each
stroke, the `covariates`: columns of the `strokes` contract. One memory is one session: one tool, one canvas.

The paint on the canvas is kept on a 2 mm grid: covered share, time and colour of the last paint in a cell. That is
enough for a median over a stroke's footprint, and cheap to copy.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import canvas_to_pixel

FloatArray = npt.NDArray[np.float64]

Footprint = tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], FloatArray, FloatArray]
"""Cells that a stroke touches, with repeats: rows, columns, covered share, time of passing; each [M]."""

CELL_M: Final = 0.002
DEFAULT_MARK_WIDTH_M: Final = 0.004
"""Width of a mark where the tool's nominal width is not known."""
PICKUP_COLUMNS: Final = ("carried_share", "carried_red", "carried_green", "carried_blue")
"""Paint picked up since the tool was loaded: amount, and colour in linear light (that of the load where none was)."""
_SETTING_S: Final = 60.0
"""Age at which half as much paint is picked up as of fresh paint."""


@dataclass(frozen=True, eq=False)
class StrokeEvent:
    """The properties of a stroke that change the memory."""

    path: FloatArray
    """[N, 5] in the canvas frame: t_s (NaN = unknown), x_m, y_m, z_m, yaw_rad; it draws where z <= 0."""
    t_start_s: float
    """Since the session's start."""
    dip: bool
    """Whether the tool was dipped just before it."""
    color_srgb: FloatArray
    """[3] sRGB in [0, 1]."""


@dataclass(frozen=True, eq=False)
class Memory:
    """The state before the next stroke, if the tool is not dipped for it. Made by `fresh_memory`."""

    canvas_size_m: tuple[float, float]
    """Width, height."""
    mark_width_m: float
    since_reload: int
    reload_id: int
    """Dips so far; 0 = the tool as it was at the session's start."""
    ink_since_reload_m: float
    tool_age_m: float
    last_color_srgb: FloatArray
    """[3]; NaN before the first stroke."""
    painted_at_s: FloatArray
    """[rows, columns] of `CELL_M`, row 0 at the top: when it was last painted; NaN = blank."""
    ink: FloatArray
    """[rows, columns]: covered share of the cell, 0..1."""
    color: FloatArray
    """[rows, columns, 3], linear light: of the paint that was last laid there; 0 where blank."""
    carried: FloatArray
    """[4]: state of the paint picked up since the tool was loaded (`pickup_step`)."""


def fresh_memory(
    canvas_size_m: tuple[float, float], mark_width_m: float = DEFAULT_MARK_WIDTH_M, tool_age_m: float = 0.0
) -> Memory:
    """The memory at the start of a session: blank canvas, tool not dipped yet.

    Raises:
        ContractError: sizes that are not positive.
    """
    width_m, height_m = canvas_size_m
    if not (min(width_m, height_m, mark_width_m) > 0 and tool_age_m >= 0):
        raise ContractError(
            f"A canvas of {width_m} x {height_m} m and a mark of {mark_width_m} m must be above 0, and a "
            f"tool age of {tool_age_m} m not negative."
        )
    shape = (math.ceil(height_m / CELL_M - 1e-6), math.ceil(width_m / CELL_M - 1e-6))
    unknown = np.full(3, np.nan)
    blank = np.full(shape, np.nan), np.zeros(shape), np.zeros((*shape, 3))
    return Memory(canvas_size_m, mark_width_m, 0, 0, 0.0, tool_age_m, unknown, *blank, np.zeros(4))


def new_sheet(memory: Memory) -> Memory:
    """The same session with a blank canvas."""
    blank = np.full_like(memory.painted_at_s, np.nan)
    return replace(memory, painted_at_s=blank, ink=np.zeros_like(memory.ink), color=np.zeros_like(memory.color))


def without_canvas(memory: Memory) -> Memory:
    """The same memory without the canvas: wet ages are NaN, and all other covariates are computed much faster."""
    nothing = np.zeros((0, 0))
    return replace(memory, painted_at_s=nothing, ink=nothing, color=np.zeros((0, 0, 3)))


def covariates(memory: Memory, stroke: StrokeEvent) -> dict[str, int | float | list[float]]:
    """The columns with memory of the strokes contract, for the next stroke."""
    return _covariates(memory, stroke, _footprint(memory, stroke.path, stroke.t_start_s))


def advance(memory: Memory, stroke: StrokeEvent) -> Memory:
    """The memory after a stroke; the old one is unchanged.

    Raises:
        ContractError: a path that is not [N, 5] or has NaN positions, or a start time that is not finite.
    """
    return _after(memory, stroke, _footprint(memory, stroke.path, stroke.t_start_s))


def covariates_and_advance(memory: Memory, stroke: StrokeEvent) -> tuple[dict[str, int | float | list[float]], Memory]:
    """``covariates`` before a stroke and the memory after it, at little more than the cost of one.

    Raises:
        ContractError: as ``advance``.
    """
    footprint = _footprint(memory, stroke.path, stroke.t_start_s)
    return _covariates(memory, stroke, footprint), _after(memory, stroke, footprint)


def _after(memory: Memory, stroke: StrokeEvent, footprint: Footprint) -> Memory:
    if not math.isfinite(stroke.t_start_s):
        raise ContractError(f"The stroke's start time is {stroke.t_start_s}; give seconds since the session's start.")
    loaded = _dipped(memory) if stroke.dip else memory
    length_m = drawn_length_m(stroke.path)
    rows, columns, covered, when_s = footprint
    painted_at_s, ink, color = memory.painted_at_s.copy(), memory.ink.copy(), memory.color.copy()
    np.fmax.at(painted_at_s, (rows, columns), when_s)
    np.maximum.at(ink, (rows, columns), covered)
    color[rows, columns] = srgb_to_linear(np.asarray(stroke.color_srgb, dtype=np.float64))
    return replace(
        loaded,
        since_reload=loaded.since_reload + 1,
        ink_since_reload_m=loaded.ink_since_reload_m + length_m,
        tool_age_m=loaded.tool_age_m + length_m,
        last_color_srgb=np.array(stroke.color_srgb, dtype=np.float64),
        painted_at_s=painted_at_s,
        ink=ink,
        color=color,
        carried=_pickup_step(loaded, memory, stroke, footprint)[1],
    )


def paint_pickup(memory: Memory, stroke: StrokeEvent) -> dict[str, float]:
    """The `PICKUP_COLUMNS` of the next stroke: paint picked up at the stroke's middle."""
    loaded = _dipped(memory) if stroke.dip else memory
    picked_up, _ = _pickup_step(loaded, memory, stroke, _footprint(memory, stroke.path, stroke.t_start_s))
    return dict(zip(PICKUP_COLUMNS, picked_up.tolist(), strict=True))


def _pickup_step(
    loaded: Memory, memory: Memory, stroke: StrokeEvent, footprint: Footprint
) -> tuple[FloatArray, FloatArray]:
    rows, columns, covered, _ = footprint
    place = np.zeros_like(memory.ink)
    np.maximum.at(place, (rows, columns), covered)
    over = place * memory.ink
    crossed = (over[..., None] * memory.color).sum((0, 1)) / max(over.sum(), 1e-12)
    share = float(over.sum() / max(place.sum(), 1e-12))
    load = srgb_to_linear(np.asarray(stroke.color_srgb, dtype=np.float64))
    return pickup_step(loaded.carried, share, crossed, _wet_age_s(memory, footprint, stroke.t_start_s), load)


def _covariates(memory: Memory, stroke: StrokeEvent, footprint: Footprint) -> dict[str, int | float | list[float]]:
    loaded = _dipped(memory) if stroke.dip else memory
    return {
        "since_reload": loaded.since_reload,
        "reload_id": loaded.reload_id,
        "ink_since_reload_m": loaded.ink_since_reload_m,
        "tool_age_m": loaded.tool_age_m,
        "wet_age_s": _wet_age_s(memory, footprint, stroke.t_start_s),
        "previous_color_srgb": [float(v) for v in memory.last_color_srgb],
    }


def drawn_length_m(path: FloatArray) -> float:
    """Length on the canvas of a path [N, 5] where it touches (z <= 0); z is linear between points."""
    points = _checked(path)
    lengths = np.linalg.norm(np.diff(points[:, 1:3], axis=0), axis=1)
    z0, z1 = points[:-1, 3], points[1:, 3]
    below, above = np.maximum(-z0, 0) + np.maximum(-z1, 0), np.maximum(z0, 0) + np.maximum(z1, 0)
    share = np.where(above == 0, 1.0, below / np.maximum(below + above, 1e-12))
    return float((lengths * share).sum())


def wet_age_s(memory: Memory, path: FloatArray, t_s: float) -> float:
    """Ink-weighted median, over the place of a path [N, 5], of the time since it was painted, at `t_s`.

    NaN where the place is blank.
    """
    return _wet_age_s(memory, _footprint(memory, path, t_s), t_s)


def _wet_age_s(memory: Memory, footprint: Footprint, t_s: float) -> float:
    rows, columns, covered, _ = footprint
    place = np.zeros_like(memory.ink)
    np.maximum.at(place, (rows, columns), covered)
    weight = place * memory.ink
    used = weight > 0
    if not used.any():
        return math.nan
    ages, weights = t_s - memory.painted_at_s[used], weight[used]
    order = np.argsort(ages, kind="stable")
    cumulative = np.cumsum(weights[order])
    return float(ages[order][np.searchsorted(cumulative, cumulative[-1] / 2)])


def _dipped(memory: Memory) -> Memory:
    return replace(memory, since_reload=0, reload_id=memory.reload_id + 1, ink_since_reload_m=0.0, carried=np.zeros(4))


def _checked(path: FloatArray) -> FloatArray:
    points = np.asarray(path, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 5 or len(points) == 0 or not np.isfinite(points[:, 1:]).all():
        raise ContractError(f"A stroke's path of shape {points.shape} must be [N, 5] with finite x, y, z and yaw.")
    return points


def _footprint(memory: Memory, path: FloatArray, t_start_s: float) -> Footprint:
    points = _checked(path)
    if memory.ink.size == 0:
        return np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0), np.zeros(0)
    samples = _resampled(points, CELL_M / 2)
    samples = samples[samples[:, 3] <= 0]
    width_m, height_m = memory.canvas_size_m
    centre = canvas_to_pixel(samples[:, 1:3], (0.0, 0.0, width_m, height_m), 1.0 / CELL_M)  # [S, 2] (column, row)
    reach = math.ceil(memory.mark_width_m / 2 / CELL_M + 0.5)
    steps = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    cells = np.rint(centre)[:, None, :] + offsets  # [S, K, 2]
    distance_m = np.linalg.norm(cells - centre[:, None, :], axis=-1) * CELL_M
    covered = np.clip((memory.mark_width_m / 2 - distance_m) / CELL_M + 0.5, 0.0, 1.0)
    columns, rows = cells[..., 0].astype(np.intp), cells[..., 1].astype(np.intp)
    height, width = memory.ink.shape
    on_canvas = (covered > 0) & (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    passing_s = t_start_s + np.nan_to_num(samples[:, 0], nan=0.0)  # unknown times: all at the start
    when_s = np.broadcast_to(passing_s[:, None], covered.shape)
    return rows[on_canvas], columns[on_canvas], covered[on_canvas], when_s[on_canvas]


def _resampled(points: FloatArray, spacing_m: float) -> FloatArray:
    """A polyline [N, 5] with points no more than `spacing_m` apart, ends included."""
    if len(points) == 1:
        return points
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[:, 1:3], axis=0), axis=1))])
    count = max(2, math.ceil(along[-1] / spacing_m) + 1)
    if along[-1] == 0.0:  # a dab: it stays in place
        return points
    at = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(at, along, points[:, i]) for i in range(5)], axis=1)


def pickup_step(
    state: FloatArray, share: float, crossed: FloatArray, age_s: float, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The pickup columns [4] at the middle of a stroke, and the state after it.

    Args:
        state: [4], amount picked up since the tool was loaded, and amount times colour; zeros for none.
        share: of the stroke's path that lies over paint.
        crossed: [3] linear light, of that paint.
        age_s: since it was painted; NaN = blank.
        load: [3] linear light, of the paint that was loaded.
    """
    taken = share / (1.0 + max(age_s, 0.0) / _SETTING_S) if math.isfinite(age_s) else 0.0
    more = taken * np.concatenate([[1.0], crossed])
    middle = state + more / 2
    mixed = middle[1:] / middle[0] if middle[0] > 0 else load
    return np.concatenate([middle[:1], mixed]), state + more
