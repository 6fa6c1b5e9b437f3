from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from pentimento.studio.clay.slab import Air, air_at, hardness_factor
from pentimento.studio.clay.world import load_clay_world

WORLD = load_clay_world("clay_table")
FRESH = Air(21.0, 0.45)


def factor(air: Air = FRESH, age_s: float = 0.0, **strengths: float) -> float:
    return hardness_factor(WORLD.material, replace(WORLD.effects, **strengths), air, age_s)


def test_fresh_material_in_neutral_air_has_its_hardness_whatever_the_effects() -> None:
    assert_allclose(factor(stiffness_drift=1.0, humidity_softening=1.0), 1.0)


def test_without_effects_neither_time_nor_air_matter() -> None:
    assert factor(Air(30.0, 0.9), 1e5) == 1.0


def test_hardness_of_drying_material_saturates() -> None:
    ages = [factor(age_s=age, stiffness_drift=1.0) for age in (0.0, 2000.0, 4000.0, 1e9)]
    assert 1.0 == ages[0] < ages[1] < ages[2] < ages[3]
    assert ages[2] - ages[1] < ages[1] - ages[0]
    assert_allclose(ages[3], 1.0 + WORLD.material.drying, rtol=1e-3)


def test_warm_and_damp_material_is_softer() -> None:
    assert factor(Air(25.0, 0.45), stiffness_drift=1.0) < 1.0 < factor(Air(18.0, 0.45), stiffness_drift=1.0)
    assert factor(Air(21.0, 0.6), humidity_softening=1.0) < 1.0 < factor(Air(21.0, 0.3), humidity_softening=1.0)


def test_air_drifts_within_its_swing_along_one_curve() -> None:
    times = np.linspace(0, 3 * WORLD.room.period_s, 400)
    airs = [air_at(WORLD.room, t, np.random.default_rng(1)) for t in times]
    warm, damp = (np.array([getattr(air, name) for air in airs]) for name in ("temperature_c", "humidity"))
    assert 0.5 < np.ptp(warm) / WORLD.room.temperature_swing_k <= 2.0
    assert 0.5 < np.ptp(damp) / WORLD.room.humidity_swing <= 2.0
    assert np.abs(np.diff(warm)).max() < 0.1 * np.ptp(warm)
    assert abs(np.corrcoef(warm, damp)[0, 1]) < 0.7
