"""Simulated worlds of strokes: a studio world drawn by seed, with a tool, nuisance parameters and hidden causes."""

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.robots.tools import Tool as ToolFile
from pentimento.robots.tools import load_tool
from pentimento.studio.strokes.world import Effects, World, load_world
from studies.blind.series import Stratum
from studies.blind.strokes.paint_context import Mode

ToolName = Literal["marker", "round_brush", "flat_brush"]

GEOMETRIC = (
    "latency",
    "backlash",
    "path_scale",
    "path_offset",
    "canvas_tilt",
    "lens_distortion",
    "vignetting",
    "illumination_gradient",
)
_EVERYWHERE = ("speed_width", "speed_density", "tool_wear", "paper_bleed")
_PAINT = ("ink_depletion", "bristle_lag", "drying_shift", "wet_mixing")
# A marker has no paint that dries visibly or stays wet, no trailing bristles and no line that press widens. Its black
# shows no change of illumination. It is never dipped, so that ink_depletion and tool_wear are the same.
CAUSES: dict[ToolName, tuple[str, ...]] = {
    "marker": (*_EVERYWHERE, "speed_bleed", "latency", "backlash", "path_scale", "path_offset", "lens_distortion"),
    "round_brush": (*_EVERYWHERE, "speed_bleed", *_PAINT, "curvature_width", *GEOMETRIC),
    "flat_brush": (*_EVERYWHERE, *_PAINT, "orientation_width", *GEOMETRIC),
}
"""For each tool the causes that its worlds can hide."""
CONFOUNDED = ("ink_depletion", "illumination_gradient", "canvas_tilt", "tool_wear", "drying_shift", "speed_width")
"""Causes of the worlds that are recorded in raster order, which aliases them with each other."""
STRENGTHS_Q = (0.1, 0.2, 0.4)

PALETTE_SRGB = (
    (0.08, 0.08, 0.10),
    (0.10, 0.12, 0.45),
    (0.50, 0.08, 0.10),
    (0.05, 0.30, 0.15),
    (0.75, 0.52, 0.08),
    (0.45, 0.30, 0.55),
)
WEAKEST = 1e-9
"""Min strength of orientation_width where it is a hidden cause.

At 0 the studio turns the bundle with the stroke and not with the arm: the effect would be discontinuous there."""
_GROOMED, _LEVEL = 0.25, 3.0
STROKES_PER_DIP = 14  # at most; the design dips more often


@dataclass(frozen=True)
class Outside:
    """An effect that no cause of the vocabulary describes: a mode of the stroke follows a column.

    `column` is a decoy column's name, or `hidden` for a wave over the execution order that no column shows.
    """

    mode: Mode
    column: str


OUTSIDE: tuple[Outside, ...] = (
    Outside("width", "temperature_c"),
    Outside("width", "motor_current_a"),
    Outside("amplitude", "hidden"),
    Outside("amplitude", "temperature_c"),
    Outside("normal", "humidity"),
    Outside("normal", "battery_v"),
    Outside("blur", "battery_v"),
    Outside("blur", "temperature_c"),
    Outside("tangential", "motor_current_a"),
    Outside("canvas_x", "temperature_c"),
    Outside("canvas_y", "humidity"),
    Outside("width", "hidden"),
)


@dataclass(frozen=True, eq=False)
class Sketch:
    """A world whose effects have no strengths yet: all effects of `world` are 0."""

    stratum: Stratum
    seed: int
    tool: ToolFile
    world: World
    palette_srgb: NDArray[np.float64]
    """[K, 3] paints of the session."""
    causes: tuple[str, ...]
    outside: Outside | None
    q: tuple[float, ...]
    """Wanted energy of each cause (or of the outside effect) over the noise floor."""
    misshaped: bool

    def with_strengths(self, strengths: tuple[float, ...]) -> World:
        """The world with its causes at these strengths. An outside effect is not part of the world."""
        given = dict(zip(self.causes, strengths, strict=True)) if self.outside is None else {}
        if "orientation_width" in given:
            given["orientation_width"] = max(given["orientation_width"], WEAKEST)
        tool = self.world.tool
        # Trailing bristles lie down: fully at any strength in the studio, in proportion to the strength here.
        tool = replace(tool, elongation=tool.elongation * min(given.get("bristle_lag", 0.0), 1.0))
        return replace(self.world, tool=tool, effects=replace(self.world.effects, **given))


def sketch_world(
    stratum: Stratum,
    seed: int,
    cause: str | None = None,
    tool: ToolName | None = None,
    q: float | None = None,
) -> Sketch:
    """Draw a world of a stratum. Tool, nuisance parameters and hidden causes follow from `seed`, unless `cause`, `tool`
    or `q` give them.

    Raises ConfigError where no tool can have the cause.
    """
    rng = np.random.default_rng([seed, 1])
    name = _draw_tool(rng, stratum, cause, tool)
    outside = OUTSIDE[rng.integers(len(OUTSIDE))] if stratum == "outside" else None
    causes = _draw_causes(rng, stratum, name, cause)
    hidden = len(causes) if outside is None else 1
    wanted = tuple(float(rng.choice(STRENGTHS_Q)) for _ in range(hidden))
    misshaped = bool(rng.random() < 0.5)
    count = int(rng.integers(2, 5))
    palette = np.array(PALETTE_SRGB)[rng.permutation(len(PALETTE_SRGB))[:count]]
    tool_file = load_tool(name)
    if tool_file.color_srgb is not None:
        palette = np.array([tool_file.color_srgb])
    else:
        tool_file = replace(tool_file, strokes_per_dip=STROKES_PER_DIP)
    world = with_nuisances(without_effects(load_world(name)), rng)
    world = misshapen(world, rng) if misshaped else _even(world)
    return Sketch(
        stratum, seed, tool_file, world, palette, causes, outside, wanted if q is None else (q,) * hidden, misshaped
    )


def _draw_tool(rng: np.random.Generator, stratum: Stratum, cause: str | None, tool: ToolName | None) -> ToolName:
    pool = CONFOUNDED if stratum == "raster" else ()
    able = [
        t for t, known in CAUSES.items() if (cause is None or cause in known) and (not pool or set(pool) & set(known))
    ]
    if tool is not None:
        able = [t for t in able if t == tool]
    if not able:
        raise ConfigError(f"No {tool or 'tool'} of the simulated worlds can have the cause {cause!r}; see CAUSES.")
    return able[rng.integers(len(able))]


def _draw_causes(rng: np.random.Generator, stratum: Stratum, tool: ToolName, cause: str | None) -> tuple[str, ...]:
    known = CAUSES[tool]
    if stratum in ("none", "outside"):
        return ()
    if stratum == "raster":
        known = tuple(c for c in CONFOUNDED if c in known)
    first = cause if cause is not None else known[rng.integers(len(known))]
    if stratum != "two":
        return (first,)
    others = [c for c in known if c != first]
    return first, others[rng.integers(len(others))]


def without_effects(world: World) -> World:
    return replace(world, effects=Effects(**{f.name: 0.0 for f in fields(Effects)}))


def with_nuisances(world: World, rng: np.random.Generator) -> World:
    """Perturb sheet, paint, camera and arm; none of these changes is a cause."""

    def by(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    white = 0.955 + 0.02 * rng.standard_normal()
    paper = replace(
        world.paper,
        color_srgb=_three(np.clip(white - np.array([0.0, *rng.uniform(0, 0.04, 2)]), 0.8, 0.99)),
        grain=world.paper.grain * by(0.6, 1.5),
        grain_m=world.paper.grain_m * by(0.7, 1.4),
        absorbency=world.paper.absorbency * by(0.6, 1.6),
        tilt_m=tuple(rng.choice([-1.0, 1.0], 2) * np.array(world.paper.tilt_m) * rng.uniform(0.5, 1.5, 2)),
    )
    camera = replace(
        world.camera,
        keystone=world.camera.keystone * float(rng.uniform(-1, 1)),
        rotation_rad=world.camera.rotation_rad * float(rng.uniform(-1, 1)),
        blur_m=world.camera.blur_m * by(0.7, 1.6),
        # From a good camera to a webcam in dim light: 0.2 to 1.5 % of noise in a pixel of the table.
        full_well=world.camera.full_well * by(0.01, 0.5),
        read_noise=world.camera.read_noise * by(0.6, 4.0),
        gradient=tuple(rng.choice([-1.0, 1.0], 2) * np.array(world.camera.gradient)),
    )
    robot = replace(
        world.robot,
        repeatability_m=world.robot.repeatability_m * by(0.5, 2.5),
        offset_m=tuple(rng.choice([-1.0, 1.0], 2) * np.array(world.robot.offset_m)),
    )
    paint = replace(
        world.paint,
        scattering=world.paint.scattering * by(0.6, 1.3),
        absorption=world.paint.absorption * by(0.6, 1.2),
        drying_s=world.paint.drying_s * by(0.6, 1.6),
        levelling_m=world.paint.levelling_m * by(0.7, 1.6),
        mixing_error=world.paint.mixing_error * by(0.5, 2.0),
    )
    return replace(world, paper=paper, camera=camera, robot=robot, paint=paint)


def _three(values: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _even(world: World) -> World:
    """A well-groomed bundle and paint that levels: a footprint close to a simple profile."""
    tool = replace(world.tool, raggedness_m=_GROOMED * world.tool.raggedness_m)
    paint = replace(world.paint, levelling_m=_LEVEL * world.paint.levelling_m)
    return replace(world, tool=tool, paint=paint)


def misshapen(world: World, rng: np.random.Generator) -> World:
    """Perturb the bundle so that its footprint is not the simulation's simple disc."""
    tool = world.tool
    scale = np.exp(rng.uniform(-0.6, 0.6, 6))
    bent = replace(
        tool,
        dome_m=tool.dome_m * float(scale[0]),
        raggedness_m=tool.raggedness_m * float(scale[1]) * 1.3,
        splay=tool.splay * float(scale[2]),
        splay_press_m=tool.splay_press_m * float(scale[3]),
        belly=float(np.clip(tool.belly * scale[4], 0.2, 0.95)),
        bristle_radius_m=tool.bristle_radius_m * float(scale[5]) ** 0.4,
    )
    return replace(world, tool=bent)
