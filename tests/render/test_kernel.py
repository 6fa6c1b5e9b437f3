"""The compiled renderer against closed forms, the dense reference, and finite differences."""

import numpy as np
import pytest
import torch

from pentimento.render import render
from pentimento.render.kernel import RenderInputError
from pentimento.stroke_dynamics.autograd import render_strokes
from pentimento.stroke_dynamics.reference import render_reference

SHAPE = (23, 31)


def strokes(count: int, points: int, seed: int, dtype: torch.dtype = torch.float64) -> list[torch.Tensor]:
    """Random strokes that cross, in pixel coordinates, with everything varying along them; and a canvas."""
    rng = np.random.default_rng(seed)
    start = rng.uniform((0, 0), (SHAPE[1], SHAPE[0]), (count, 1, 2))
    steps = np.cumsum(rng.normal(0, 2.5, (count, points, 2)), axis=1)
    arrays = [
        (start + steps)[None],
        rng.uniform(1, 4, (1, count, points)),
        rng.uniform(0.3, 1, (1, count, points)),
        rng.uniform(0.4, 1.5, (1, count, points)),
        rng.uniform(0, 1, (1, count, 3)),
        rng.uniform(0, 1, (1, *SHAPE, 3)),
    ]
    return [torch.tensor(a, dtype=dtype) for a in arrays]


def one_stroke(points: list[list[float]], radius: float, softness: float = 1.0) -> np.ndarray:
    """Coverage [H, W] of one stroke of full density."""
    n = len(points)
    image, _ = render(
        np.array(points, float)[None, None],
        np.full((1, 1, n), radius),
        np.ones((1, 1, n)),
        np.full((1, 1, n), softness),
        np.ones((1, 1, 3)),
        np.zeros((1, *SHAPE, 3)),
    )
    return image[0, ..., 0]


def test_a_straight_stroke_is_a_capsule_with_the_thesis_profile() -> None:
    coverage = one_stroke([[8.0, 10.0], [20.0, 10.0]], radius=4.0, softness=0.5)
    columns, rows = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    distance = np.hypot(columns - np.clip(columns, 8, 20), rows - 10)
    np.testing.assert_allclose(coverage, np.clip(1 - distance / 4, 0, 1) ** 0.5, atol=1e-12)


def test_the_thesis_distance_taken_literally_would_draw_an_infinite_line() -> None:
    """(5.1) takes the least of the distance to the *line* and to both ends; (5.2) drops the projection's sign."""
    u, v, pixel = np.array([8.0, 10.0]), np.array([20.0, 10.0]), np.array([29.0, 10.0])
    edge = (v - u) / np.linalg.norm(v - u)
    to_line = np.linalg.norm((pixel - u) - ((pixel - u) @ edge) * edge)
    literal = min(to_line, np.linalg.norm(pixel - u), np.linalg.norm(pixel - v))
    assert literal == 0  # 9 px beyond the stroke's end, and yet "on" it
    assert one_stroke([u.tolist(), v.tolist()], radius=4.0)[10, 29] == 0
    behind = np.array([6.0, 10.0])
    assert abs((behind - u) @ edge) / 12 > 0  # (5.2): the pixel behind the start would take the height further on
    assert min(max((behind - u) @ edge / 12, 0), 1) == 0


def test_a_point_is_a_disc() -> None:
    coverage = one_stroke([[15.0, 11.0]], radius=5.0)
    columns, rows = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    np.testing.assert_allclose(coverage, np.clip(1 - np.hypot(columns - 15, rows - 11) / 5, 0, 1), atol=1e-12)


def test_later_strokes_cover_earlier_ones() -> None:
    same = np.array([[[10.0, 10.0], [20.0, 10.0]]] * 2)[None]
    ones = np.ones((1, 2, 2))
    color = np.array([[[1.0, 0, 0], [0, 0, 1.0]]])
    image, _ = render(same, 3 * ones, ones, 0 * ones, color, np.ones((1, *SHAPE, 3)))
    np.testing.assert_allclose(image[0, 10, 15], [0, 0, 1])


@pytest.mark.parametrize("points", [1, 2, 9])
def test_values_agree_with_the_reference(points: int) -> None:
    inputs = strokes(6, points, seed=points)
    dense = render_reference(*(x[0] for x in inputs))
    torch.testing.assert_close(render_strokes(*inputs)[0], dense, atol=1e-10, rtol=0)
    single = render_strokes(*(x.float() for x in inputs))[0]
    assert float((single - dense).abs().max()) <= 1e-5


def test_gradients_agree_with_the_reference() -> None:
    inputs = [x.requires_grad_(True) for x in strokes(6, 7, seed=3)]
    weight = torch.randn(1, *SHAPE, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    ours = torch.autograd.grad((render_strokes(*inputs) * weight).sum(), inputs)
    dense = torch.autograd.grad((render_reference(*(x[0] for x in inputs)) * weight[0]).sum(), inputs)
    for name, a, b in zip(("points", "radius", "density", "softness", "color", "canvas"), ours, dense, strict=True):
        assert float((a - b).norm() / b.norm()) <= 1e-6, name


def test_gradients_agree_with_finite_differences() -> None:
    inputs = [x.requires_grad_(True) for x in strokes(2, 3, seed=5)]
    assert torch.autograd.gradcheck(render_strokes, inputs, eps=1e-7, atol=1e-4, rtol=1e-3)


def test_constant_and_varying_profiles_are_one_formula() -> None:
    inputs = strokes(4, 6, seed=8)
    inputs[2] = torch.full_like(inputs[2], 0.8)
    inputs[3] = torch.full_like(inputs[3], 0.7)
    constant = render_strokes(*inputs)
    inputs[3][..., -1] += 1e-12  # takes the general way through the kernel
    torch.testing.assert_close(render_strokes(*inputs), constant, atol=1e-9, rtol=0)


def test_batches_are_paintings_of_their_own() -> None:
    first, second = strokes(3, 5, seed=1), strokes(3, 5, seed=2)
    together = render_strokes(*(torch.cat(pair) for pair in zip(first, second, strict=True)))
    torch.testing.assert_close(together[0], render_strokes(*first)[0])
    torch.testing.assert_close(together[1], render_strokes(*second)[0])


@pytest.mark.parametrize(
    "points",
    [
        [[5.0, 5.0], [5.0, 5.0]],  # zero length
        [[-90.0, 5.0], [-80.0, 9.0]],  # off the canvas
        [[1e6, -1e6], [2e6, 5.0]],  # far off
        [[3.0, 3.0], [9.0, 9.0], [9.0, 9.0], [4.0, 9.0]],  # a repeated point
    ],
)
@pytest.mark.parametrize("radius", [0.0, 3.0])
def test_degenerate_strokes_stay_finite(points: list[list[float]], radius: float) -> None:
    n = len(points)
    inputs = [
        torch.tensor(points, dtype=torch.float64)[None, None],
        torch.full((1, 1, n), radius, dtype=torch.float64),
        torch.ones(1, 1, n, dtype=torch.float64),
        torch.full((1, 1, n), 0.1, dtype=torch.float64),
        torch.ones(1, 1, 3, dtype=torch.float64),
        torch.zeros(1, *SHAPE, 3, dtype=torch.float64),
    ]
    for x in inputs:
        x.requires_grad_(True)
    image = render_strokes(*inputs)
    gradients = torch.autograd.grad(image.sum(), inputs)
    assert torch.isfinite(image).all()
    assert all(torch.isfinite(g).all() for g in gradients)


def test_what_is_not_finite_is_named() -> None:
    inputs = [x.numpy() for x in strokes(3, 4, seed=0)]
    inputs[0][0, 2, 1, 0] = np.nan
    with pytest.raises(RenderInputError, match=r"points\[0, 2, 1, 0\] is nan"):
        render(*inputs)


def test_shapes_that_do_not_fit_are_named() -> None:
    inputs = [x.numpy() for x in strokes(3, 4, seed=0)]
    inputs[1] = inputs[1][:, :2]
    with pytest.raises(RenderInputError, match="radius must have shape"):
        render(*inputs)
