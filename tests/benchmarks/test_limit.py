"""The loops without branches compute what they claim to, and the count of pairs with ink is right."""

import platform

import numpy as np
import pytest
import torch

from benchmarks.limit import (
    BLOCK,
    FIELDS,
    READ,
    WRITTEN,
    forward_backward_pairs,
    forward_pairs,
    packed_instructions,
    random_pairs,
    touched_pairs,
)
from benchmarks.scenes import Case, as_painting, strokes_and_canvas
from pentimento.render import render
from pentimento.render.coverage import HALF_PX, RIM_PX

SIZE = 96


def fields(blocks: np.ndarray) -> dict[str, torch.Tensor]:
    by_field = blocks.reshape(len(blocks), FIELDS, BLOCK).swapaxes(0, 1).reshape(FIELDS, -1)
    return {name: torch.tensor(row, dtype=torch.float64) for name, row in zip(READ + WRITTEN, by_field, strict=True)}


def by_autograd(x: dict[str, torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor, list[torch.Tensor]]:
    """Coverage [P], image [P, 3] and the gradients of u, v, radius, density, softness, colour, below; by PyTorch."""
    edge = torch.stack([x["ex"], x["ey"]], dim=-1)
    offset = torch.stack([x["gx"], x["gy"]], dim=-1)
    u, v = torch.zeros_like(edge), edge.clone()
    ends = [torch.stack([x[f"{name}_u"], x[f"{name}_u"] + x[f"{name}_step"]], dim=-1) for name in ("r", "rho", "c")]
    color, below, pull = (
        torch.stack([x[f"{name}{channel}"] for channel in ("red", "green", "blue")], dim=-1)
        for name in ("", "below_", "g_")
    )
    leaves = [tensor.requires_grad_() for tensor in (u, v, *ends, color, below)]
    along = v - u
    t = (((offset - u) * along).sum(-1) / along.square().sum(-1)).clamp(0.0, 1.0)
    distance = (offset - u - t[:, None] * along).norm(dim=-1)
    radius, density, softness = (pair[:, 0] + t * (pair[:, 1] - pair[:, 0]) for pair in ends)
    q = ((radius - distance).clamp(min=RIM_PX) / radius).clamp(max=1.0)
    share = torch.minimum(radius, distance + HALF_PX) + torch.minimum(radius, HALF_PX - distance)
    coverage = density * q**softness * share.clamp(min=0.0)
    image = below + coverage[:, None] * (color - below)
    return coverage, image, list(torch.autograd.grad(image, leaves, pull))


def test_every_number_that_the_loop_writes_is_that_of_automatic_differentiation() -> None:
    blocks = random_pairs(3, seed=4)
    given = fields(blocks)
    forward_backward_pairs(blocks, 1)
    done = fields(blocks)
    coverage, image, gradients = by_autograd(given)
    expected = [coverage, *image.unbind(-1), *(column for g in gradients for column in g.unbind(-1))]
    inked = coverage > 0
    assert 0.3 < inked.double().mean() < 1  # both sides of the rim
    for name, truth in zip(WRITTEN, expected, strict=True):
        difference = (done[name] - truth.detach()).norm() / truth.detach().norm()
        assert difference < 2e-5, f"{name} is off by {difference:.1e} of its norm"


def test_the_forward_loop_finds_the_same_coverage() -> None:
    one, other = random_pairs(2, seed=5), random_pairs(2, seed=5)
    forward_pairs(one, 1)
    forward_backward_pairs(other, 1)
    np.testing.assert_allclose(fields(one)["coverage"], fields(other)["coverage"], rtol=1e-4, atol=1e-5)


def test_blocks_start_with_a_cache_line() -> None:
    assert all(random_pairs(blocks, 0).ctypes.data % 64 == 0 for blocks in (1, 2, 3, 5))


def test_a_second_pass_changes_nothing() -> None:
    once, twice = random_pairs(2, seed=6), random_pairs(2, seed=6)
    forward_backward_pairs(once, 1)
    forward_backward_pairs(twice, 2)
    np.testing.assert_array_equal(once, twice)


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads x86 assembly")
def test_the_compiler_makes_vector_instructions_of_both_loops() -> None:
    blocks = random_pairs(1, seed=7)
    for loop in (forward_pairs, forward_backward_pairs):
        loop(blocks, 1)
        assert packed_instructions(loop) > 10


def test_a_disc_touches_the_pixels_within_half_a_pixel_of_its_radius() -> None:
    radius = 7.3
    rows, columns = np.mgrid[:SIZE, :SIZE]
    expected = int((np.hypot(columns - 40.2, rows - 50.7) < radius + HALF_PX).sum())
    points = np.array([[[40.2, 50.7]]], np.float32)
    assert touched_pairs(points, np.full((1, 1), radius, np.float32), SIZE, SIZE) == expected


def test_a_long_straight_segment_touches_the_area_of_a_capsule() -> None:
    points, radius, length = np.array([[[20.0, 40.0], [70.0, 55.0]]], np.float32), 4.0, np.hypot(50, 15)
    touched, reach = touched_pairs(points, np.full((1, 2), radius, np.float32), SIZE, SIZE), radius + HALF_PX
    assert touched == pytest.approx(2 * reach * length + np.pi * reach**2, rel=0.02)


def test_culling_lets_through_at_least_what_ink_touches() -> None:
    """Evaluations ≥ touched pairs ≥ fragments, counted by two programs that share no code."""
    for points in (4, 32):
        inputs = [tensor.numpy() for tensor in strokes_and_canvas(Case(30, points, SIZE))]
        bands = render(*as_painting(*inputs))[1][0]
        touched = touched_pairs(inputs[0][0], inputs[1][0], SIZE, SIZE)
        inked = sum(int(band.start[-1]) for band in bands)
        assert sum(band.evaluations for band in bands) >= touched >= inked > 0
        if points == 4:
            crossing = sum(
                touched_pairs(inputs[0][0][:, k : k + 2], inputs[1][0][:, k : k + 2], SIZE, SIZE) for k in range(3)
            )
            assert crossing == touched
