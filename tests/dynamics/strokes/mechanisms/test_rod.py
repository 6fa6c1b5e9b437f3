"""What a rod sweeps, against the union of rods at many places of its path."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pentimento.dynamics.strokes.mechanisms.orientation_width import MIN_POINTS, OrientationWidth, direction, swept
from pentimento.dynamics.strokes.simulation import StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

SIZE = 90
HALF_LENGTH, HALF_THICKNESS = 14.2, 4.3
POINTS = 16


def path(length: float, bend: float) -> torch.Tensor:
    """From left to right about the middle, [1, 1, N, 2], pixels."""
    t = torch.linspace(0, 1, POINTS, dtype=torch.float64)
    return torch.stack([SIZE / 2 + length * (t - 0.5), SIZE / 2 + 4 * bend * t * (1 - t)], dim=-1)[None, None]


def union_of_discs(mark: Mark) -> NDArray[np.bool_]:
    """[SIZE, SIZE]: within the radius of a place on the mark's line, by brute force."""
    numbers = np.arange(mark.radius_m.shape[-1])
    fields = torch.cat([mark.points_m[0, 0], mark.radius_m[0, 0, :, None]], dim=-1).numpy()
    discs = np.stack([np.interp(np.linspace(0, numbers[-1], 600), numbers, field) for field in fields.T], axis=-1)
    rows, columns = np.mgrid[:SIZE, :SIZE]
    found = np.zeros((SIZE, SIZE), dtype=bool)
    for x, y, radius in discs:
        found |= np.hypot(columns - x, rows - y) < radius
    return found


def union_of_rods(points: torch.Tensor, angle: float) -> NDArray[np.bool_]:
    """[SIZE, SIZE]: within a half-thickness of a rod's axis, by brute force."""
    xy = points[0, 0].numpy()
    t = np.linspace(0, len(xy) - 1, 400)
    middles = np.stack([np.interp(t, np.arange(len(xy)), xy[:, i]) for i in range(2)], axis=-1)
    rows, columns = np.mgrid[:SIZE, :SIZE]
    along = np.array([np.cos(angle), np.sin(angle)])
    found = np.zeros((SIZE, SIZE), dtype=bool)
    for x, y in middles:
        offset = np.stack([columns - x, rows - y], axis=-1)
        nearest = np.clip(offset @ along, -HALF_LENGTH, HALF_LENGTH)
        found |= np.linalg.norm(offset - nearest[..., None] * along, axis=-1) < HALF_THICKNESS
    return found


def overlap(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """Intersection over union."""
    return float((one & other).sum() / (one | other).sum())


def rods_and_marks(points: torch.Tensor, degrees: float) -> tuple[NDArray[np.bool_], Mark, Mark]:
    """The union of the rods, the mark for it, and one as wide with round ends."""
    one = torch.ones(1, 1, POINTS, dtype=torch.float64)
    angle = np.radians(degrees)
    axis = torch.tensor([np.cos(angle), np.sin(angle)]).expand(1, 1, POINTS, 2)
    along = direction(points)
    across = (axis[..., 0] * along[..., 1] - axis[..., 1] * along[..., 0]).abs()
    round_ended = Mark(points, HALF_THICKNESS + HALF_LENGTH * across, one, one)
    return union_of_rods(points, angle), swept(round_ended, axis, HALF_LENGTH * one, HALF_THICKNESS * one), round_ended


@pytest.mark.parametrize("degrees", [0, 25, 45, 70, 90, 135, 180])
@pytest.mark.parametrize("length", [50.0, 16.0])
def test_a_mark_is_the_union_of_the_rods_along_a_straight_path(degrees: int, length: float) -> None:
    points = path(length, 0.0)
    expected, mark, _ = rods_and_marks(points, degrees)
    assert mark.points_m.shape == points.shape
    assert overlap(union_of_discs(mark), expected) > 0.985


@pytest.mark.parametrize("degrees", [0, 25, 45, 70, 90, 135])
def test_along_a_bent_path_it_comes_nearer_to_that_than_round_ends(degrees: int) -> None:
    expected, mark, round_ended = rods_and_marks(path(50.0, 6.0), degrees)
    assert overlap(union_of_discs(mark), expected) > overlap(union_of_discs(round_ended), expected) + 0.02


def strokes(points: int) -> tuple[Mark, StrokeContext]:
    """One stroke of 30 mm along x, its tool's broad edge along y."""
    t = torch.linspace(0, 1, points, dtype=torch.float64)
    commanded = torch.stack([t, 0.03 * t, 0 * t, 0 * t - 0.002, 0 * t + np.pi / 2], dim=-1)[None, None]
    one = torch.ones(1, 1, points, dtype=torch.float64)
    return Mark(commanded[..., 1:3], 0.003 * one, one, one), StrokeContext(commanded, {})


def test_broadside_stroke_of_a_flat_tool_has_square_ends() -> None:
    plain, context = strokes(24)
    mark = OrientationWidth(torch.tensor([-0.6, 0.0], dtype=torch.float64), {}).mark(plain, context)
    x, y = mark.points_m[0, 0].T
    ahead = float((x + mark.radius_m[0, 0]).max()) - 0.03
    aside = float((y + mark.radius_m[0, 0]).max())
    assert 0 < ahead < 0.8 * 0.003 < 1.6 * 0.003 < aside


@pytest.mark.parametrize(("points", "oblong"), [(24, 0.002), (MIN_POINTS - 1, 0.6)])
def test_a_patch_that_is_a_little_oblong_or_of_few_points_is_wider_and_reaches_less_far(
    points: int, oblong: float
) -> None:
    plain, context = strokes(points)
    mark = OrientationWidth(torch.tensor([-oblong, 0.0], dtype=torch.float64), {}).mark(plain, context)
    torch.testing.assert_close(mark.radius_m, plain.radius_m * np.exp(oblong), rtol=1e-3, atol=0)
    x, radius = mark.points_m[0, 0, :, 0], mark.radius_m[0, 0]
    reach = 0.003 * np.exp(-oblong)
    assert float((x + radius).max()) - 0.03 == pytest.approx(reach, rel=1e-3)
    assert float((radius - x).max()) == pytest.approx(reach, rel=1e-3)


def test_rod_mark_is_continuous_in_the_patch_orientation() -> None:
    """A rod turned by half a turn is the same, and so must be the order in which its corners are drawn."""
    points = path(40.0, 10.0)
    commanded = torch.zeros(1, 1, POINTS, 5, dtype=torch.float64)
    commanded[..., 1:3], commanded[..., 4] = points, 0.3
    plain = Mark(points, *(torch.ones(3, 1, 1, POINTS, dtype=torch.float64) * 9.0))
    for degrees in range(0, 360, 15):  # of the doubled angle; 180 is where an arc tangent jumps
        marks = []
        for turned in (-1e-6, 1e-6):
            twice = np.radians(degrees) + turned
            values = 0.5 * torch.tensor([np.cos(twice), np.sin(twice)])
            marks.append(OrientationWidth(values, {}).mark(plain, StrokeContext(commanded, {})))
        assert float((marks[1].points_m - marks[0].points_m).abs().max()) < 1e-3
