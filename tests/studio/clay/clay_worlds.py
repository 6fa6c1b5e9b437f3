"""Small clay worlds and pushes that the clay studio's tests share."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.studio.clay.studio import ClayStudio
from pentimento.studio.clay.world import ClayWorld, load_clay_world

Array = NDArray[np.float64]
SIZE_M = 0.1
SURFACE_M = 0.04


def clay_with(base: str = "clay_table", **strengths: float) -> ClayWorld:
    """A small slab of the named world's material, level and without errors of the arm, with no effects but these."""
    world = load_clay_world(base)
    none = dict.fromkeys(vars(world.effects), 0.0)
    return replace(
        world,
        slab=replace(
            world.slab, size_m=(SIZE_M, SIZE_M), cells=96, height_spread_m=0.0, undulation_m=0.0, roughness_m=0.0
        ),
        material=replace(world.material, mottle=0.0, tear_m=0.0),
        arm=replace(world.arm, contact_error_m=0.0, repeatability_m=0.0),
        scanner=replace(world.scanner, pixels=48),
        effects=replace(world.effects, **(none | strengths)),
    )


def material_with(world: ClayWorld, **numbers: Any) -> ClayWorld:
    """The world with these numbers of its material."""
    return replace(world, material=replace(world.material, **numbers))


def press(
    studio: ClayStudio,
    action: tuple[float, float, float, float, float] = (0.035, 0.05, 0.0, 0.03, 0.007),
    speed_m_s: float = 0.02,
    dwell_s: float = 0.5,
    retract_speed_m_s: float = 0.05,
) -> Array:
    """Push, and return the change of height float64[H,W] in metres."""
    before = studio.truth_height_m()
    studio.push(np.array(action), SURFACE_M, speed_m_s, dwell_s, retract_speed_m_s)
    return studio.truth_height_m() - before


def pressed(world: ClayWorld, tool: str = "ball", seed: int = 1, **push: Any) -> Array:
    """The change of height that one push leaves in fresh material."""
    studio = ClayStudio(world, seed)
    studio.take(tool)
    return press(studio, **push)
