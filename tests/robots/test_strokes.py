"""The Bézier action against its own definition."""

import numpy as np

from pentimento.robots.strokes import press_basis, stroke_points


def bezier(control: np.ndarray, t: np.ndarray) -> np.ndarray:
    weights = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)
    return weights @ control


def test_the_shape_is_the_thesis_cubic_bezier() -> None:
    """Horizontal coordinates linear from 0 to l, vertical ones 0 at the ends and b in the middle (4.3.1)."""
    length, bend = 0.04, 0.006
    control = np.array([[0, 0], [length / 3, bend], [2 * length / 3, bend], [length, 0]]) - [length / 2, 0]
    points = stroke_points(np.zeros(2), 0.0, length, bend_m=bend, press_m=np.full(3, 1e-3), yaw_rad=0.0, points=20)
    np.testing.assert_allclose(points[:, :2], bezier(control, np.linspace(0, 1, 20)), atol=1e-12)


def test_the_pose_is_that_of_the_middle() -> None:
    middle = np.array([0.1, 0.05])
    for theta in (0.0, 0.7, -2.5):
        points = stroke_points(middle, theta, 0.03, bend_m=0.0, press_m=np.full(3, 1e-3), yaw_rad=0.3, points=5)
        np.testing.assert_allclose(points[2, :2], middle, atol=1e-12)
        heading = points[-1, :2] - points[0, :2]
        np.testing.assert_allclose(heading, 0.03 * np.array([np.cos(theta), np.sin(theta)]), atol=1e-12)
        np.testing.assert_allclose(points[:, 3], 0.3)


def test_bend_is_to_the_left_of_the_heading() -> None:
    points = stroke_points(np.zeros(2), np.pi / 2, 0.03, bend_m=0.004, press_m=np.full(3, 1e-3), yaw_rad=0.0, points=11)
    assert points[5, 0] < 0  # heading up the canvas, left is −x
    assert points[5, 0] == -0.75 * 0.004


def test_press_points_down_and_passes_through_its_ends() -> None:
    points = stroke_points(
        np.zeros(2), 0.0, 0.03, bend_m=0.0, press_m=np.array([1e-3, 2e-3, 3e-3]), yaw_rad=0.0, points=7
    )
    np.testing.assert_allclose(points[[0, -1], 2], [-1e-3, -3e-3])
    np.testing.assert_allclose(press_basis(7).sum(1), 1)
    assert (np.diff(points[:, 2]) < 0).all()
