"""Uneven ends of a mark."""

import torch

from pentimento.diagnosis.strokes.model import UnevenEnds
from pentimento.dynamics.strokes.simulation import StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark


def straight() -> tuple[StrokeContext, Mark]:
    path = torch.zeros(1, 1, 20, 5, dtype=torch.float64)
    path[..., 1] = torch.linspace(0.1, 0.14, 20)
    ones = torch.ones(1, 1, 20, dtype=torch.float64)
    return StrokeContext(path, {}), Mark(path[..., 1:3].clone(), 0.002 * ones, ones, ones)


def ends(*values: float) -> UnevenEnds:
    return UnevenEnds(torch.tensor(values, dtype=torch.float64), {})


def test_each_end_moves_along_the_path_by_its_own_amount() -> None:
    context, mark = straight()
    moved = ends(0.001, -0.002, 0, 0).mark(mark, context)
    shift = moved.points_m - mark.points_m
    torch.testing.assert_close(shift[0, 0, 0], torch.tensor([-0.001, 0.0], dtype=torch.float64))
    torch.testing.assert_close(shift[0, 0, -1], torch.tensor([-0.002, 0.0], dtype=torch.float64))
    assert not shift[..., 1].any()


def test_shortened_stroke_does_not_fold() -> None:
    """Each end is 4 mm short; its neighbour lies 2 mm away."""
    context, mark = straight()
    along_m = ends(-0.004, -0.004, 0, 0).mark(mark, context).points_m[0, 0, :, 0]
    assert bool((along_m.diff() > 0).all())
    torch.testing.assert_close(along_m[[0, -1]], torch.tensor([0.104, 0.136], dtype=torch.float64))


def test_ends_meet_in_the_middle_at_most() -> None:
    context, mark = straight()
    along_m = ends(-0.05, -0.05, 0, 0).mark(mark, context).points_m[0, 0, :, 0]
    assert float(along_m[0]) < 0.12 < float(along_m[-1])


def test_widening_fades_away_from_its_end() -> None:
    context, mark = straight()
    ratio = (ends(0, 0, 0.3, 0).mark(mark, context).radius_m / mark.radius_m).log()[0, 0]
    assert abs(float(ratio[0]) - 0.3) < 1e-9
    assert bool((ratio.diff() < 0).all())
    assert float(ratio[-1]) < 1e-6


def test_uneven_ends_at_zero_are_the_identity() -> None:
    context, mark = straight()
    for before, after in zip(mark, ends(0, 0, 0, 0).mark(mark, context), strict=True):
        torch.testing.assert_close(before, after)


def test_moved_ends_keep_the_width_at_each_place() -> None:
    context, mark = straight()
    tapered = mark._replace(radius_m=0.001 + 0.05 * (mark.points_m[..., 0] - 0.1))
    moved = ends(-0.003, -0.005, 0, 0).mark(tapered, context)
    torch.testing.assert_close(moved.radius_m, 0.001 + 0.05 * (moved.points_m[..., 0] - 0.1))
