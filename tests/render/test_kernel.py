"""The compiled renderer against closed forms, the dense reference, and finite differences."""

import numpy as np
import pytest
import torch

from pentimento.dynamics.strokes.autograd import render_strokes
from pentimento.dynamics.strokes.reference import render_reference
from pentimento.render import PixelStrokes, kernel, render, render_backward
from pentimento.render.kernel import RenderInputError
from tests.render.paintings import painting

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
    stroke = PixelStrokes(
        points=np.array(points, float)[None, None],
        radius=np.full((1, 1, n), radius),
        density=np.ones((1, 1, n)),
        softness=np.full((1, 1, n), softness),
        color=np.ones((1, 1, 3)),
    )
    image, _ = render(stroke, np.zeros((1, *SHAPE, 3)))
    return image[0, ..., 0]


def test_straight_stroke_is_a_capsule_with_the_thesis_profile() -> None:
    coverage = one_stroke([[8.0, 10.0], [20.0, 10.0]], radius=4.0, softness=0.5)
    columns, rows = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    distance = np.hypot(columns - np.clip(columns, 8, 20), rows - 10)
    inside = distance <= 3.5
    np.testing.assert_allclose(coverage[inside], (1 - distance[inside] / 4) ** 0.5, atol=1e-12)
    assert (coverage[distance >= 4.5] == 0).all()


def test_thesis_distance_as_printed_gives_an_infinite_line() -> None:
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


def test_single_point_is_a_disc() -> None:
    coverage = one_stroke([[15.0, 11.0]], radius=5.0)
    columns, rows = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    distance = np.hypot(columns - 15, rows - 11)
    np.testing.assert_allclose(coverage[distance <= 4.5], 1 - distance[distance <= 4.5] / 5, atol=1e-12)
    assert (coverage[distance >= 5.5] == 0).all()


@pytest.mark.parametrize("radius", [0.1, 0.3, 0.5, 0.77, 2.0, 3.3])
def test_a_crisp_line_covers_its_area_wherever_it_lies(radius: float) -> None:
    """Across a horizontal line with c = 0 the coverage sums up to its width, between and on pixel centres."""
    for row in (10.0, 10.23, 10.5, 10.81):
        coverage = one_stroke([[2.0, row], [28.0, row]], radius=radius, softness=0.0)
        assert coverage[:, 15].sum() == pytest.approx(2 * radius)


def test_the_gradient_of_a_crisp_mark_is_the_slope_of_its_area() -> None:
    """A disc of radius R has the area π R², whose slope is 2 π R, for any c that is nearly 0."""
    disc = [
        torch.tensor([[[[15.3, 11.2]]]], dtype=torch.float64),
        torch.full((1, 1, 1), 6.0, dtype=torch.float64),
        torch.ones(1, 1, 1, dtype=torch.float64),
        torch.full((1, 1, 1), 1e-3, dtype=torch.float64),
        torch.ones(1, 1, 3, dtype=torch.float64),
        torch.zeros(1, *SHAPE, 3, dtype=torch.float64),
    ]
    radius = disc[1].requires_grad_(True)
    area = render_strokes(*painting(*disc))[..., 0].sum()
    assert float(area.detach()) == pytest.approx(np.pi * 6**2, rel=0.02)
    assert float(torch.autograd.grad(area, radius)[0]) == pytest.approx(2 * np.pi * 6, rel=0.05)


def test_later_strokes_cover_earlier_ones() -> None:
    same = np.array([[[10.0, 10.0], [20.0, 10.0]]] * 2)[None]
    ones = np.ones((1, 2, 2))
    color = np.array([[[1.0, 0, 0], [0, 0, 1.0]]])
    image, _ = render(PixelStrokes(same, 3 * ones, ones, 0 * ones, color), np.ones((1, *SHAPE, 3)))
    np.testing.assert_allclose(image[0, 10, 15], [0, 0, 1])


@pytest.mark.parametrize("points", [1, 2, 9])
def test_render_agrees_with_the_reference(points: int) -> None:
    inputs = strokes(6, points, seed=points)
    dense = render_reference(*painting(*(x[0] for x in inputs)))
    torch.testing.assert_close(render_strokes(*painting(*inputs))[0], dense, atol=1e-10, rtol=0)
    single = render_strokes(*painting(*(x.float() for x in inputs)))[0]
    assert float((single - dense).abs().max()) <= 1e-5


def test_render_gradients_agree_with_the_reference() -> None:
    inputs = [x.requires_grad_(True) for x in strokes(6, 7, seed=3)]
    weight = torch.randn(1, *SHAPE, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    ours = torch.autograd.grad((render_strokes(*painting(*inputs)) * weight).sum(), inputs)
    dense = torch.autograd.grad((render_reference(*painting(*(x[0] for x in inputs))) * weight[0]).sum(), inputs)
    for name, a, b in zip(("points", "radius", "density", "softness", "color", "canvas"), ours, dense, strict=True):
        assert float((a - b).norm() / b.norm()) <= 1e-6, name


def test_render_gradients_agree_with_finite_differences() -> None:
    inputs = [x.requires_grad_(True) for x in strokes(2, 3, seed=5)]
    assert torch.autograd.gradcheck(
        lambda *leaves: render_strokes(*painting(*leaves)), inputs, eps=1e-7, atol=1e-4, rtol=1e-3
    )


def with_pickup(inputs: list[torch.Tensor], seed: int) -> list[torch.Tensor]:
    """The same strokes by tools that pick up paint, on a canvas that is wet here and there."""
    rng = np.random.default_rng(seed)
    wet = torch.tensor(rng.uniform(0, 1, (*inputs[5].shape[:3], 1)), dtype=inputs[5].dtype)
    pickup = torch.tensor(rng.uniform(0.2, 0.9, inputs[4].shape[:2]), dtype=inputs[5].dtype)
    return [*inputs[:5], torch.cat([inputs[5], wet], dim=-1), pickup]


@pytest.mark.parametrize("points", [1, 6])
def test_pickup_agrees_with_the_reference(points: int) -> None:
    inputs = [x.requires_grad_(True) for x in with_pickup(strokes(5, points, seed=4), seed=4)]
    weight = torch.randn(1, *SHAPE, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    ours, dense = render_strokes(*painting(*inputs)), render_reference(*painting(*(x[0] for x in inputs)))
    torch.testing.assert_close(ours[0], dense, atol=1e-10, rtol=0)
    g_ours = torch.autograd.grad((ours * weight).sum(), inputs)
    g_dense = torch.autograd.grad((dense * weight[0]).sum(), inputs)
    names = ("points", "radius", "density", "softness", "color", "canvas", "pickup")
    for name, a, b in zip(names, g_ours, g_dense, strict=True):
        assert float((a - b).norm() / b.norm()) <= 1e-6, name


def test_no_pickup_by_clean_tools_or_from_dry_canvas() -> None:
    inputs = with_pickup(strokes(4, 5, seed=6), seed=6)
    plain = render_strokes(*painting(*inputs[:5], inputs[5][..., :3].contiguous()))
    clean = render_strokes(*painting(*inputs[:6], torch.zeros_like(inputs[6])))
    torch.testing.assert_close(clean[..., :3], plain)
    one = [x[:, :1] for x in inputs[:5]]
    dry = inputs[5].clone()
    dry[..., 3] = 0
    on_dry = render_strokes(*painting(*one, dry, inputs[6][:, :1]))
    torch.testing.assert_close(on_dry[..., :3], render_strokes(*painting(*one, dry[..., :3].contiguous())))


def test_pickup_carries_paint_forward_only() -> None:
    """Blue over a wet red patch in the middle: blue before the patch, tinged with red after it."""
    canvas = np.ones((1, 21, 81, 4))
    canvas[..., 3] = 0
    canvas[0, :, 35:45] = (1.0, 0.0, 0.0, 1.0)
    path = np.stack([np.linspace(8, 72, 33), np.full(33, 10.0)], axis=1)[None, None]
    ones = np.ones((1, 1, 33))
    blue, pickup = np.array([[[0.0, 0.0, 1.0]]]), np.array([[0.8]])
    image, _ = render(PixelStrokes(path, 4 * ones, ones, 0 * ones, blue, pickup), canvas)
    red = image[0, 10, :, 0]
    assert red[12] == 0 and red[28] == 0
    assert 0.02 < red[60] < 0.8
    assert red[70] < red[50]  # what was picked up thins out
    assert image[0, 10, 60, 3] == 1  # and what was laid is wet


def test_bands_leave_no_seam_in_tall_canvases() -> None:
    """Bands of rows are an implementation's matter: no seam, and all strokes' gradients are whole."""
    rng = np.random.default_rng(0)
    height, width, n = 150, 37, 5
    start = rng.uniform((0, 0), (width, height), (12, 1, 2))
    points = start + np.cumsum(rng.normal(0, 18, (12, n, 2)), axis=1)
    arrays = (
        points,
        *(rng.uniform(a, b, (12, n)) for a, b in ((1, 9), (0.3, 1), (0.4, 1.5))),
        rng.uniform(0, 1, (12, 3)),
    )
    inputs = [torch.tensor(a)[None].requires_grad_(True) for a in (*arrays, rng.uniform(0, 1, (height, width, 3)))]
    weight = torch.tensor(rng.normal(size=(1, height, width, 3)))
    ours, dense = render_strokes(*painting(*inputs)), render_reference(*painting(*(x[0] for x in inputs)))
    torch.testing.assert_close(ours[0], dense, atol=1e-10, rtol=0)
    g_ours = torch.autograd.grad((ours * weight).sum(), inputs)
    g_dense = torch.autograd.grad((dense * weight[0]).sum(), inputs)
    for a, b in zip(g_ours, g_dense, strict=True):
        assert float((a - b).norm() / b.norm()) <= 1e-6


@pytest.mark.parametrize("carried", [False, True])
def test_render_is_independent_of_threads(carried: bool) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 200, (2, 30, 6, 2)).astype(np.float32)
    shapes = (points.shape[:3],) * 3 + ((2, 30, 3), (2, 200, 70, 4 if carried else 3))
    *profile, canvas = (rng.uniform(0.2, 2, shape).astype(np.float32) for shape in shapes)
    pickup = rng.uniform(0, 1, (2, 30)).astype(np.float32) if carried else None
    lines = PixelStrokes(points, *profile, pickup=pickup)
    image, fragments = render(lines, canvas)
    gradients = render_backward(lines, fragments, image)
    again, fragments = render(lines, canvas, threads=3)
    gradients_again = render_backward(lines, fragments, again, threads=3)
    np.testing.assert_array_equal(image, again)
    for one, other in zip(gradients, gradients_again, strict=True):
        np.testing.assert_array_equal(one, other)


def test_single_precision_gradients_agree_with_the_reference() -> None:
    rng = np.random.default_rng(2)
    t = np.linspace(0, 1, 12)[:, None]
    start, end = rng.uniform(0, 64, (2, 15, 1, 2))
    arrays = (
        start + (end - start) * t,
        rng.uniform(1.5, 5, (15, 1)).repeat(12, axis=1),
        np.ones((15, 12)),
        np.full((15, 12), 0.3),
        rng.uniform(0, 1, (15, 3)),
        np.ones((64, 64, 3)),
    )
    exact = [torch.tensor(a).requires_grad_(True) for a in arrays]
    single = [torch.tensor(a, dtype=torch.float32)[None].requires_grad_(True) for a in arrays]
    weight = torch.tensor(rng.normal(size=(64, 64, 3)))
    dense = torch.autograd.grad((render_reference(*painting(*exact)) * weight).sum(), exact)
    ours = torch.autograd.grad((render_strokes(*painting(*single))[0] * weight).sum(), single)
    for name, a, b in zip(("points", "radius", "density", "softness", "color", "canvas"), ours, dense, strict=True):
        assert float((a[0] - b).norm() / b.norm()) <= 1e-4, name


def test_constant_and_varying_profiles_agree() -> None:
    inputs = strokes(4, 6, seed=8)
    inputs[1] = torch.full_like(inputs[1], 2.3)  # where the radius varies, the two may choose different segments
    inputs[2] = torch.full_like(inputs[2], 0.8)
    inputs[3] = torch.full_like(inputs[3], 0.7)
    constant = render_strokes(*painting(*inputs))
    inputs[3][..., -1] += 1e-12  # takes the general way through the kernel
    torch.testing.assert_close(render_strokes(*painting(*inputs)), constant, atol=1e-9, rtol=0)


def test_a_tapering_stroke_of_one_density_agrees_with_the_reference() -> None:
    """Also beside thin parts, where a thick segment has a smaller D/R and yet no ink."""
    inputs = strokes(20, 8, seed=9)
    inputs[1] = inputs[1].sub(1).mul(2)
    inputs[2], inputs[3] = torch.full_like(inputs[2], 0.8), torch.full_like(inputs[3], 0.3)
    dense = render_reference(*painting(*(x[0] for x in inputs)))
    torch.testing.assert_close(render_strokes(*painting(*inputs))[0], dense, atol=1e-10, rtol=0)


def test_batched_paintings_are_independent() -> None:
    first, second = strokes(3, 5, seed=1), strokes(3, 5, seed=2)
    together = render_strokes(*painting(*(torch.cat(pair) for pair in zip(first, second, strict=True))))
    torch.testing.assert_close(together[0], render_strokes(*painting(*first))[0])
    torch.testing.assert_close(together[1], render_strokes(*painting(*second))[0])


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
    image = render_strokes(*painting(*inputs))
    gradients = torch.autograd.grad(image.sum(), inputs)
    assert torch.isfinite(image).all()
    assert all(torch.isfinite(g).all() for g in gradients)


def test_render_rejects_values_that_are_not_finite() -> None:
    inputs = [x.numpy() for x in strokes(3, 4, seed=0)]
    inputs[0][0, 2, 1, 0] = np.nan
    with pytest.raises(RenderInputError, match=r"points\[0, 2, 1, 0\] is nan"):
        render(*painting(*inputs))


def test_render_rejects_wrong_shapes() -> None:
    inputs = [x.numpy() for x in strokes(3, 4, seed=0)]
    inputs[1] = inputs[1][:, :2]
    with pytest.raises(RenderInputError, match="radius must have shape"):
        render(*painting(*inputs))


@pytest.mark.parametrize("place", range(6))
@pytest.mark.parametrize("value", [4, [[[4.0]]]])
def test_render_rejects_what_is_no_array(place: int, value: object) -> None:
    inputs: list[object] = [x.numpy() for x in strokes(3, 4, seed=0)]
    inputs[place] = value
    with pytest.raises(RenderInputError, match=rf"is of type {type(value).__name__}; give a NumPy array"):
        render(PixelStrokes(*inputs[:5]), inputs[5])  # type: ignore[arg-type]


def test_render_rejects_whole_numbers() -> None:
    inputs = [x.numpy().astype(int) for x in strokes(3, 4, seed=0)]
    with pytest.raises(RenderInputError, match="points are int64; give arrays of float32"):
        render(*painting(*inputs))


def test_render_rejects_huge_values() -> None:
    inputs = [x.numpy() for x in strokes(3, 4, seed=0)]
    inputs[1][0, 1, 2] = 1e30
    with pytest.raises(RenderInputError, match=r"radius\[0, 1, 2\] is 1e\+30"):
        render(*painting(*inputs))


@pytest.mark.parametrize("shape", [(1, 65_536, 1, 3), (1, 1, 65_536, 3)])
def test_render_rejects_canvases_over_65535_pixels(shape: tuple[int, ...]) -> None:
    inputs = [x.numpy() for x in strokes(3, 4, seed=0)]
    with pytest.raises(RenderInputError, match=f"{shape[1]} x {shape[2]} pixels; it takes sides up to 65535: render"):
        render(PixelStrokes(*inputs[:5]), np.zeros(shape))
    render(PixelStrokes(*inputs[:5]), np.zeros((1, min(shape[1], 65_535), min(shape[2], 65_535), 3)))


def test_render_rejects_paths_over_65535_segments() -> None:
    """Of 65 535 segments the last, which alone lays ink, is told from all others."""
    n = 65_536
    points = np.zeros((1, 1, n, 2))
    points[..., :-1, :], points[..., -1, :] = -50.0, (15.0, 11.0)
    shape, canvas = points.shape[:-1], np.zeros((1, *SHAPE, 3))
    line = PixelStrokes(points, np.ones(shape), np.ones(shape), np.ones(shape), np.ones((1, 1, 3)))
    image, fragments = render(line, canvas)
    gradients = render_backward(line, fragments, np.ones_like(image))
    assert set(np.flatnonzero(gradients.radius)) == {n - 2, n - 1}
    longer = [np.repeat(array, [1] * (n - 1) + [2], axis=2) for array in line[:4]]
    with pytest.raises(RenderInputError, match="paths have 65536 segments; it takes up to 65535 in a path: give fewer"):
        render(PixelStrokes(*longer, line.color), canvas)


def test_render_rejects_ink_beyond_free_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "_free_bytes", lambda: 1_000_000)
    monkeypatch.setattr(kernel, "_ASK_ABOUT_BYTES", 0)
    inputs = [x.numpy() for x in strokes(300, 4, seed=0)]
    inputs[1][0, 7] *= 10
    with pytest.raises(RenderInputError, match=r"Most comes from points\[0, 7\]"):
        render(*painting(*inputs))
    render(PixelStrokes(*inputs[:5]).at((slice(None), slice(3))), inputs[5])  # a few fit


def test_render_of_no_strokes_keeps_the_canvas() -> None:
    inputs = [x.numpy() for x in strokes(2, 4, seed=0)]
    image, _ = render(PixelStrokes(*inputs[:5]).at((slice(None), slice(0))), inputs[5])
    np.testing.assert_array_equal(image, inputs[5])
