"""Strokes as arrays are the strokes that robots execute."""

import numpy as np

from pentimento.planning.strokes.bezier import Strokes, no_strokes
from pentimento.robots.strokes import stroke_points
from pentimento.robots.tools import load_tool
from tests.planning.strokes.scenes import same, strokes_at


def bent(count: int) -> Strokes:
    rng = np.random.default_rng(0)
    strokes = strokes_at(*rng.uniform((0.03, 0.03), (0.09, 0.05), (count, 2)).tolist())
    strokes.bend_m[:] = rng.uniform(-4e-3, 4e-3, count)
    strokes.press_m[:] = rng.uniform(5e-4, 2e-3, (count, 3))
    return strokes


def test_bezier_paths_agree_with_robot_strokes() -> None:
    strokes = bent(6)
    for s, path in enumerate(strokes.paths(12)):
        middle, theta, length, bend, press = (array[s].astype(float) for array in strokes.arrays()[:-1])
        points = stroke_points(middle, theta, length, bend_m=bend, press_m=press, yaw_rad=0.0, points=12)
        np.testing.assert_allclose(path[:, 1:4], points[:, :3], atol=1e-7)


def test_to_planned_adds_times_only() -> None:
    strokes = bent(4)
    for path, planned in zip(strokes.paths(9), strokes.planned(load_tool("round_brush"), 9), strict=True):
        np.testing.assert_allclose(planned.path[:, 1:4], path[:, 1:4], atol=1e-7)
        assert (np.diff(planned.path[:, 0]) > 0).all()


def test_pick_and_joined_copy() -> None:
    strokes = bent(5)
    halves = strokes.pick(slice(0, 2)).joined(strokes.pick(np.array([2, 3, 4])))
    assert same(halves, strokes)
    halves.middle_m += 1
    assert not same(halves, strokes)
    assert same(no_strokes().joined(strokes), strokes)


def test_pick_keeps_and_joined_drops_inherited_covariates() -> None:
    strokes = bent(3)
    strokes.inherited = {"order": np.arange(3, dtype=np.float32)}
    picked = strokes.pick(np.array([2, 0]))
    assert picked.inherited is not None
    np.testing.assert_array_equal(picked.inherited["order"], [2, 0])
    assert picked.joined(strokes).inherited is None


def test_keep_within_keeps_allowed_strokes() -> None:
    strokes = bent(6)
    kept = strokes.pick(slice(None))
    kept.keep_within(load_tool("round_brush"), (0.12, 0.08), 5e-3)
    assert same(kept, strokes)
