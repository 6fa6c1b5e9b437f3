from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pentimento.contracts.errors import ContractError
from pentimento.studio.clay.studio import ClayStudio
from pentimento.studio.clay.world import load_clay_world
from tests.studio.clay.clay_worlds import SURFACE_M, Array, clay_with, material_with, press, pressed

CELL_M = 0.1 / 96


def volume_m3(change: Array) -> float:
    return float(change.sum()) * CELL_M**2


def dent_m3(change: Array) -> float:
    return float(-np.minimum(change, 0).sum()) * CELL_M**2


def test_without_effects_it_is_a_plastic_dent_whose_volume_heaps_up_around_it() -> None:
    change = pressed(clay_with())
    assert abs(volume_m3(change)) < 1e-12 < dent_m3(change)
    assert change.max() > 5e-4
    assert_allclose(change[:, :20], 0, atol=1e-4)


@pytest.mark.parametrize("tool", ["ball", "ball_small", "edge", "flat", "soft_pad", "gripper"])
@pytest.mark.parametrize("base", ["clay_table", "foam", "dough", "sand"])
def test_volume_changes_by_what_the_pores_swallow(tool: str, base: str) -> None:
    world = load_clay_world(base)
    small = clay_with(base, **vars(world.effects))
    studio = ClayStudio(replace(small, material=world.material), 2)
    studio.take(tool)
    before = studio.truth_volume_m3()
    for x_m in (0.045, 0.055):
        press(studio, (x_m, 0.05, 1.0, 0.012, 0.006))
    assert studio.truth_volume_m3() - before == pytest.approx(-studio.lost_m3, rel=1e-6, abs=1e-13)
    assert (studio.lost_m3 > 0) == (world.effects.volume_loss > 0)


def test_y_points_up_and_theta_turns_to_the_left() -> None:
    change = pressed(clay_with(), action=(0.05, 0.05, np.pi / 2, 0.025, 0.006))
    row, column = np.unravel_index(change.argmin(), change.shape)
    assert_allclose([(column + 0.5) * CELL_M, 0.1 - (row + 0.5) * CELL_M], [0.05, 0.075], atol=0.003)


def test_one_seed_is_one_world_and_another_seed_another() -> None:
    def bytes_of(seed: int) -> bytes:
        studio = ClayStudio(load_clay_world("sand"), seed)
        studio.take("ball")
        press(studio)
        return studio.scan().height_m.tobytes()

    assert bytes_of(1) == bytes_of(1) != bytes_of(2)


def test_springback_fills_the_dent_and_a_rest_sets_it() -> None:
    plain, elastic = pressed(clay_with()), pressed(clay_with(springback=1.0))
    assert plain.min() < elastic.min() < 0
    assert elastic.max() < plain.max()
    assert abs(volume_m3(elastic)) < 1e-12
    rested = pressed(clay_with(springback=1.0), dwell_s=4.0)
    assert rested.min() < elastic.min()


def test_volume_loss_takes_from_the_rims_and_not_from_the_dent() -> None:
    plain, lossy = pressed(clay_with()), pressed(clay_with(volume_loss=1.0))
    assert lossy.max() < 0.8 * plain.max()
    assert_allclose(lossy.min(), plain.min(), rtol=0.03)
    assert -volume_m3(lossy) > 0.3 * dent_m3(lossy)


def test_slopes_slide_down_to_their_repose() -> None:
    world = clay_with(slope_slide=1.0)
    slopes = [float(np.abs(np.diff(pressed(w), axis=1)).max()) / CELL_M for w in (clay_with(), world)]
    assert slopes[1] < 1.3 * world.material.repose < 0.7 * slopes[0]
    assert abs(volume_m3(pressed(world))) < 1e-12


def test_far_field_raises_places_that_nothing_touched() -> None:
    far = (slice(0, 15), slice(0, 15))
    plain, spread = pressed(clay_with()), pressed(clay_with(far_field=1.0))
    assert_array_equal(plain[far], 0)
    assert spread[far].min() > 3e-6
    assert abs(volume_m3(spread)) < 1e-12


def test_worked_material_deforms_less_and_smoothing_forgets_it() -> None:
    def second(strength: float, smooth: bool) -> Array:
        studio = ClayStudio(clay_with(work_hardening=strength), 1)
        studio.take("ball")
        press(studio, (0.045, 0.05, 0.0, 0.01, 0.006))
        if smooth:
            studio.smooth()
        return press(studio, (0.045, 0.058, 0.0, 0.01, 0.006))

    assert dent_m3(second(1.0, smooth=False)) < 0.9 * dent_m3(second(0.0, smooth=False))
    assert_allclose(second(1.0, smooth=True), second(0.0, smooth=True), atol=1e-9)


def test_a_fast_retract_draws_a_higher_peak() -> None:
    def lift(strength: float, speed_m_s: float) -> float:
        action = (0.05, 0.05, 0.0, 0.0, 0.006)
        change = pressed(clay_with(adhesion_lift=strength), action=action, retract_speed_m_s=speed_m_s)
        return float(change[47:49, 47:49].mean())

    assert lift(0.0, 0.1) == pytest.approx(lift(0.0, 0.01), abs=1e-9)
    assert lift(0.0, 0.1) < lift(1.0, 0.01) < lift(1.0, 0.1)


def later(strength: float, seconds: float) -> Array:
    studio = ClayStudio(clay_with(stiffness_drift=strength), 1)
    studio.take("ball")
    studio.wait(seconds)
    return press(studio)


def test_old_material_is_stiffer() -> None:
    assert dent_m3(later(1.0, 6000.0)) < 0.9 * dent_m3(later(0.0, 6000.0))
    assert_allclose(later(0.0, 6000.0), later(0.0, 0.0), atol=1e-9)


def test_a_height_offset_deepens_and_play_shifts() -> None:
    def centre(change: Array) -> float:
        dent = -np.minimum(change, 0)
        return float((dent * np.arange(96)).sum() / dent.sum()) * CELL_M

    plain = pressed(clay_with())
    assert dent_m3(pressed(clay_with(height_offset=1.0))) > 1.1 * dent_m3(plain)
    shift = centre(pressed(clay_with(tool_backlash=1.0))) - centre(plain)
    assert shift == pytest.approx(-load_clay_world("clay_table").arm.backlash_m[0] / 2, rel=0.3)


def test_a_fast_tool_leaves_a_wider_groove_only_under_that_effect() -> None:
    def width(strength: float, speed_m_s: float) -> int:
        change = pressed(clay_with(speed_footprint=strength), speed_m_s=speed_m_s)
        return int((change[:, 55] < -5e-4).sum())

    assert width(0.0, 0.06) == width(0.0, 0.008)
    assert width(1.0, 0.06) > width(1.0, 0.008)


def test_a_resting_tool_sinks_only_under_that_effect() -> None:
    def depth(strength: float, dwell_s: float) -> float:
        return float(pressed(clay_with(dwell_creep=strength), dwell_s=dwell_s).min())

    assert depth(0.0, 4.0) == pytest.approx(depth(0.0, 0.0), abs=1e-9)
    assert depth(1.0, 4.0) < depth(1.0, 0.0) - 1e-4


def test_damp_material_is_softer_only_under_that_effect() -> None:
    base = clay_with(humidity_softening=1.0)
    damp, dry = (replace(base, room=replace(base.room, humidity=h, humidity_swing=0.0)) for h in (0.7, 0.2))
    assert dent_m3(pressed(damp)) > 1.03 * dent_m3(pressed(dry))
    without = replace(damp, effects=replace(damp.effects, humidity_softening=0.0))
    assert_array_equal(pressed(without), pressed(clay_with()))


def test_strength_grows_the_effect() -> None:
    def difference(name: str, strength: float) -> float:
        return float(np.square(pressed(clay_with(**{name: strength})) - pressed(clay_with())).mean())

    for name in ("springback", "volume_loss", "far_field", "height_offset", "tool_backlash", "adhesion_lift"):
        assert 0 < difference(name, 0.5) < difference(name, 1.0), name


def test_a_pinch_presses_on_both_sides_and_heaps_up_between() -> None:
    change = pressed(clay_with(), tool="gripper", action=(0.05, 0.05, 0.0, 0.028, 0.008))
    dented = (change < -0.002).any(axis=0)
    assert dented[:48].any()
    assert dented[48:].any()
    assert change[40:56, 47:49].mean() > 5e-4
    assert_allclose(change, change[:, ::-1], atol=2e-4)


def test_worked_material_is_harder_at_the_next_push() -> None:
    studio = ClayStudio(clay_with(), 1)
    studio.take("ball")
    first = press(studio)
    assert dent_m3(press(studio)) < 0.4 * dent_m3(first)


def test_time_passes_by_what_is_done() -> None:
    studio = ClayStudio(clay_with(), 1)
    clocks = [studio.clock_s]
    acts: list[Callable[[], object]] = [
        lambda: studio.take("ball"), lambda: press(studio), studio.scan, studio.smooth, lambda: studio.wait(3.0)
    ]  # fmt: skip
    for act in acts:
        act()
        clocks.append(studio.clock_s)
    assert np.all(np.diff(clocks) > 0)
    assert clocks[-1] - clocks[-2] == 3.0


def test_impossible_commands_are_named() -> None:
    studio = ClayStudio(clay_with(), 1)
    with pytest.raises(ContractError, match="hand is empty"):
        press(studio)
    with pytest.raises(ContractError, match="ball_small"):
        studio.take("chisel")
    studio.take("ball")
    for action in (np.full(5, np.nan), np.array([0.05, 0.05, 0, -0.01, 0.005]), np.zeros(4)):
        with pytest.raises(ContractError, match="five finite numbers"):
            studio.push(action, SURFACE_M, 0.02, 0.0, 0.05)
    with pytest.raises(ContractError, match="Time"):
        studio.wait(-1.0)


def test_material_numbers_matter() -> None:
    hard = material_with(clay_with(), hardness_pa=1e5)
    assert dent_m3(pressed(hard)) < 0.8 * dent_m3(pressed(clay_with()))


def test_effects_stronger_than_material_allows_swallow_all_of_it_and_no_more() -> None:
    change = pressed(clay_with(volume_loss=5.0, far_field=9.0))
    assert change.max() < 1e-4
    assert 0 < -volume_m3(change) <= dent_m3(change)


def test_copy_of_a_studio_is_independent_and_reproduces_it() -> None:
    world = load_clay_world("clay_table")
    studio = ClayStudio(world, 4)
    studio.take("ball")
    action = np.array([0.1, 0.1, 0.4, 0.02, 0.006])
    studio.push(action, 0.04, 0.02, 0.5, 0.05)
    counterfactual, other = (
        studio.in_world(world),
        studio.in_world(replace(world, arm=replace(world.arm, offset_m=0.01))),
    )
    for one in (counterfactual, other, studio):
        one.push(np.add(action, [0.01, 0, 0, 0, 0]), 0.04, 0.02, 0.5, 0.05)
    assert (
        np.array_equal(counterfactual.truth_height_m(), studio.truth_height_m())
        and counterfactual.clock_s == studio.clock_s
    )
    assert np.array_equal(counterfactual.scan().height_m, studio.scan().height_m, equal_nan=True)
