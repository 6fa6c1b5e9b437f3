"""Simulated worlds of pushes: a studio world drawn by seed, with a tool, nuisance parameters and hidden causes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from pentimento.collection.pushes import PushCollectionConfig
from pentimento.robots.tools import EndEffector, load_end_effector
from pentimento.studio.clay.world import ClayEffects, ClayWorld, load_clay_world
from studies.blind.series import Stratum

GEOMETRIC = ("height_offset", "tool_backlash")
MATERIAL = (
    "springback", "volume_loss", "slope_slide", "far_field", "work_hardening", "adhesion_lift", "stiffness_drift",
)  # fmt: skip
CAUSES = (*GEOMETRIC, *MATERIAL)
STRENGTHS_Q = (0.1, 0.2, 0.4)
TOOLS = ("ball", "ball_small")
"""Rigid tools only: the scans cannot distinguish the compliance of a soft tool from springback."""


@dataclass(frozen=True)
class Outside:
    """An effect of the studio that no cause of the vocabulary describes, and its mode and covariate."""

    effect: str
    mode: str
    column: str


OUTSIDE = (
    Outside("humidity_softening", "depth", "humidity"),
    Outside("speed_footprint", "width", "speed_m_s"),
    Outside("dwell_creep", "depth", "dwell_s"),
)


@dataclass(frozen=True, eq=False)
class Sketch:
    """A world whose effects have no strengths yet: all effects of `world` are 0."""

    stratum: Stratum
    seed: int
    tool: EndEffector
    world: ClayWorld
    config: PushCollectionConfig
    causes: tuple[str, ...]
    outside: Outside | None
    q: tuple[float, ...]
    """Wanted energy of each cause (or of the outside effect) over the noise floor."""
    misshaped: bool

    @property
    def effects(self) -> tuple[str, ...]:
        """The studio's effects that have a strength here."""
        return self.causes if self.outside is None else (self.outside.effect,)

    def with_strengths(self, strengths: Mapping[str, float]) -> ClayWorld:
        """The world with some of its effects at these strengths."""
        return replace(self.world, effects=replace(self.world.effects, **strengths))


def sketch_world(stratum: Stratum, seed: int, cause: str | None = None, q: float | None = None) -> Sketch:
    """Draw a world of a stratum. Tool, nuisance parameters and hidden causes follow from `seed`, unless `cause` or `q`
    give them.
    """
    rng = np.random.default_rng([seed, 51])
    tool = TOOLS[rng.integers(len(TOOLS))]
    outside = OUTSIDE[rng.integers(len(OUTSIDE))] if stratum == "outside" else None
    causes = _draw_causes(rng, stratum, cause)
    hidden = len(causes) if outside is None else 1
    wanted = tuple(float(rng.choice(STRENGTHS_Q)) for _ in range(hidden))
    misshaped = bool(rng.random() < 0.5)
    world = _nuisances(_without_effects(load_clay_world("clay_table")), rng)
    if misshaped:
        world = _misshapen(world, tool, rng)
    config = PushCollectionConfig(
        pushes=168, repeated=24, times=3, pushes_per_smoothing=(2, 6), revisit_share=0.5, edge_m=0.03,
        scan_pixels=128, seed=seed,
    )  # fmt: skip
    return Sketch(
        stratum, seed, load_end_effector(tool), world, config, causes, outside,
        wanted if q is None else (q,) * hidden, misshaped,
    )  # fmt: skip


def _draw_causes(rng: np.random.Generator, stratum: Stratum, cause: str | None) -> tuple[str, ...]:
    if stratum in ("none", "outside"):
        return ()
    first = cause if cause is not None else CAUSES[rng.integers(len(CAUSES))]
    if stratum == "one":
        return (first,)
    others = [c for c in CAUSES if c != first]
    return first, others[rng.integers(len(others))]


def _without_effects(world: ClayWorld) -> ClayWorld:
    return replace(world, effects=ClayEffects(**{f.name: 0.0 for f in fields(ClayEffects)}))


def _nuisances(world: ClayWorld, rng: np.random.Generator) -> ClayWorld:
    """Perturb material, slab, arm, scanner and room; none of these changes is a cause."""

    def by(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    material = replace(
        world.material,
        hardness_pa=world.material.hardness_pa * by(0.7, 1.3),
        firming_m=world.material.firming_m * by(0.7, 1.5),
        mottle=world.material.mottle * by(0.6, 1.5),
        rim_m=world.material.rim_m * by(0.8, 1.25),
        bow_wave=float(rng.uniform(0.6, 0.95)),
        tear_m=world.material.tear_m * by(0.6, 2.0),
    )
    slab = replace(world.slab, undulation_m=world.slab.undulation_m * by(0.6, 1.5))
    arm = replace(world.arm, give_m_per_n=world.arm.give_m_per_n * by(0.7, 1.4))
    scanner = replace(
        world.scanner,
        noise_m=world.scanner.noise_m * by(0.5, 2.0),
        azimuth_rad=float(rng.uniform(-np.pi, np.pi)),
        tilt=(0.004 * float(rng.uniform(-1, 1)), 0.004 * float(rng.uniform(-1, 1))),
    )
    room = replace(world.room, period_s=world.room.period_s * by(0.4, 1.2))
    return replace(world, material=material, slab=slab, arm=arm, scanner=scanner, room=room)


def _misshapen(world: ClayWorld, tool: str, rng: np.random.Generator) -> ClayWorld:
    """Give the tool a flattened tip and sides that are not a ball's."""
    shape = world.tools[tool]
    flat = replace(
        shape,
        rounding_m=shape.rounding_m * float(rng.uniform(0.65, 0.9)),
        shank=shape.shank * float(rng.uniform(0.5, 1.0)),
    )
    return replace(world, tools=world.tools | {tool: flat})
