"""How a bundle follows its tip."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.studio.strokes.brush import DAB_STEPS, Drag, drag, make_bundle
from pentimento.studio.strokes.motion import Gears, execute
from pentimento.studio.strokes.world import load_world
from tests.studio.strokes.worlds import arc, straight, world_with


def _drag(path: np.ndarray, base: str = "plain", worn_m: float = 0.0, **strengths: float) -> Drag:
    world = world_with(base, **strengths)
    tip = execute(
        path, world.robot, world.effects, canvas_size_m=(0.3, 0.2), gears=Gears(), rng=np.random.default_rng(0)
    )
    friction = np.random.default_rng(1).standard_normal(len(tip.pose) + 2 * DAB_STEPS)
    return drag(tip, np.zeros(len(tip.pose)), world.tool, effects=world.effects, worn_m=worn_m, friction=friction)


def _half_width_m(moved: Drag) -> float:
    """Largest displacement of a bristle across a stroke along +x."""
    return float(np.abs(moved.frame[len(moved.frame) // 2, 1]).max())


@pytest.mark.parametrize("name", ["round_brush", "flat_brush", "marker"])
def test_bundles_fill_their_cross_section(name: str) -> None:
    tool = load_world(name).tool
    bundle = make_bundle(tool, np.random.default_rng(0))
    assert bundle.place.shape == (tool.bristles, 2)
    assert np.abs(bundle.place - bundle.place.mean(axis=0)).max() <= 1.15


@pytest.mark.parametrize("bristles", [36, 37, 38, 39])
@pytest.mark.parametrize("name", ["round_brush", "flat_brush", "marker"])
def test_contact_patch_is_centred_at_the_tip_at_every_press(name: str, bristles: int) -> None:
    tool = replace(load_world(name).tool, bristles=bristles)
    bundle = make_bundle(tool, np.random.default_rng(3))
    assert len(bundle.place) == len(bundle.short_m) == len(bundle.wetting) == bristles
    for press in np.linspace(0.2, 1.0, 5) * tool.splay_press_m:
        laid = bundle.wetting * np.maximum(press - bundle.short_m, 0)
        np.testing.assert_allclose(laid @ bundle.place, 0.0, atol=1e-9)
        touching = bundle.place[laid > 0]
        np.testing.assert_allclose(touching.min(0, initial=0), -touching.max(0, initial=0))
        # Not askew either: whatever lies ahead on the left lies ahead on the right.
        np.testing.assert_allclose(laid @ bundle.place.prod(axis=1), 0.0, atol=1e-9)


def test_press_widens_a_round_brush_less_and_less() -> None:
    widths = [_half_width_m(_drag(straight(depth_m=depth))) for depth in (0.001, 0.002, 0.003, 0.004)]
    gains = np.diff(widths)
    assert np.all(gains > 0)
    assert np.all(np.diff(gains) < 0)


def test_the_patch_stays_with_the_tip_without_lag_and_trails_with_it() -> None:
    path = straight(length_m=0.06, depth_m=0.003)
    plain, lagging = _drag(path), _drag(path, bristle_lag=1.0)
    trail = plain.patch[:, 0] - lagging.patch[:, 0]
    assert plain.patch[-1, 0] == pytest.approx(0.16, abs=2e-4)
    assert trail[DAB_STEPS] == 0
    assert 0.004 < trail[-DAB_STEPS] < 0.009
    assert 0 < trail[-1] < trail[-DAB_STEPS]


def test_a_lagging_patch_cuts_corners() -> None:
    plain, lagging = _drag(arc(0.015)), _drag(arc(0.015), bristle_lag=1.0)
    centre = np.array([0.1, 0.115])
    assert np.linalg.norm(plain.patch - centre, axis=1).min() > 0.0145
    assert np.linalg.norm(lagging.patch - centre, axis=1)[60:-60].mean() < 0.0145


def test_a_flat_tool_is_broad_across_its_edge_only() -> None:
    along = _half_width_m(_drag(straight(yaw_rad=0.0), "flat_brush", orientation_width=1.0))
    across = _half_width_m(_drag(straight(yaw_rad=np.pi / 2), "flat_brush", orientation_width=1.0))
    assert across / along == pytest.approx(0.0051 / 0.0013, rel=0.05)
    without = [_drag(straight(yaw_rad=yaw), "flat_brush").frame for yaw in (0.0, np.pi / 2)]
    assert np.array_equal(*without)


def test_speed_narrows_and_thins() -> None:
    slow, fast = straight(speed_m_s=0.02), straight(speed_m_s=0.1)
    assert _half_width_m(_drag(fast, speed_width=1.0)) < 0.9 * _half_width_m(_drag(slow, speed_width=1.0))
    assert _drag(fast, speed_density=1.0).film.max() < 0.8 * _drag(slow, speed_density=1.0).film.max()
    assert _half_width_m(_drag(fast)) == pytest.approx(_half_width_m(_drag(slow)))
    assert np.all(_drag(fast).film == 1)


def test_use_widens_a_tip_quickly_at_first() -> None:
    new, used, old = (_half_width_m(_drag(straight(), worn_m=m, tool_wear=1.0)) for m in (0.0, 5.0, 10.0))
    assert used - new > old - used > 0
    assert _half_width_m(_drag(straight(), worn_m=10.0)) == new


def test_outer_bristles_swing_out_in_a_bend() -> None:
    moved = _drag(arc(0.012), curvature_width=1.0)
    middle = len(moved.patch) // 2
    outwards = moved.patch[middle] - np.array([0.1, 0.112])
    assert moved.outer[middle] @ outwards > 0.8 * np.linalg.norm(outwards) * np.linalg.norm(moved.outer[middle]) > 0
    assert not _drag(arc(0.012)).outer.any()
    assert np.abs(_drag(straight(), curvature_width=1.0).outer).max() < 1e-3


@pytest.mark.parametrize("lag", [0.0, 0.5])
def test_outer_bristles_swing_out_during_touch_down_and_lift_off(lag: float) -> None:
    """Bristles that trail rest at first."""
    moved = _drag(arc(0.012), curvature_width=1.0, bristle_lag=lag)
    centre = np.array([0.1, 0.112])
    outwards = moved.patch - centre
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    out = np.einsum("mk,mk->m", moved.outer, outwards)
    assert out.min() > -0.01 * out.max()
    assert max(out[0], out[-1]) < 1.1 * np.median(out)


@pytest.mark.parametrize("lag", [0.0, 0.5])
def test_a_straight_stroke_throws_nothing_outwards_whichever_way_it_goes(lag: float) -> None:
    across = straight()[:, [0, 2, 1, 3, 4]]
    assert np.abs(_drag(across, curvature_width=1.0, bristle_lag=lag).outer).max() < 1e-3
