"""Effects of single strokes on the error, against one rendering per stroke."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from pentimento.render import PixelStrokes, render
from pentimento.render.kernel import RenderInputError
from pentimento.render.strokewise import fall_with, rise_without

HEIGHT, WIDTH = 70, 90  # more than one band of rows
Strokes = PixelStrokes[np.ndarray]


def strokes(count: int, seed: int) -> Strokes:
    """Bent strokes, some of which leave the canvas."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-5, 95, (count, 1, 2))
    points = start + np.cumsum(rng.normal(0, 6, (count, 5, 2)), axis=1)
    shape = (count, 5)
    return PixelStrokes(
        points,
        rng.uniform(1, 6, shape),
        rng.uniform(0.4, 1, shape),
        rng.uniform(0, 1, shape),
        rng.random((count, 3)),
    )


def pictures(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    canvas, target = (cv2.GaussianBlur(rng.random((HEIGHT, WIDTH, 3)), (0, 0), 2) for _ in range(2))
    return canvas, target


def laid(lines: Strokes, canvas: np.ndarray) -> np.ndarray:
    return render(lines.at(None), canvas[None])[0][0]


def error(image: np.ndarray, target: np.ndarray, distances: tuple[int, ...]) -> float:
    def lightness(light: np.ndarray, distance: int) -> np.ndarray:
        return np.sqrt(np.maximum(cv2.blur(light, (distance, distance), borderType=cv2.BORDER_CONSTANT), 0))

    return float(np.mean([np.square(lightness(image, d) - lightness(target, d)).sum() / 3 for d in distances]))


@pytest.mark.parametrize("distances", [(1,), (2,), (5,), (1, 4)])
def test_stroke_effects_agree_with_rendering(distances: tuple[int, ...]) -> None:
    lines, (canvas, target) = strokes(12, 3), pictures(4)
    without, alone = (
        rise_without(lines, canvas, target, distances=distances),
        fall_with(lines, canvas, target, distances=distances),
    )
    everyone, nobody = (error(image, target, distances) for image in (laid(lines, canvas), canvas))
    for s in range(12):
        others = laid(lines.at([i for i in range(12) if i != s]), canvas)
        assert without[s] == pytest.approx(error(others, target, distances) - everyone, rel=1e-9, abs=1e-9)
        single = laid(lines.at([s]), canvas)
        assert alone[s] == pytest.approx(nobody - error(single, target, distances), rel=1e-9, abs=1e-9)


def test_single_stroke_has_equal_gain_and_contribution() -> None:
    lines, (canvas, target) = strokes(1, 5), pictures(6)
    np.testing.assert_allclose(
        rise_without(lines, canvas, target, distances=(1, 3)),
        fall_with(lines, canvas, target, distances=(1, 3)),
        rtol=1e-9,
    )


def test_invisible_strokes_have_no_effect() -> None:
    disc = np.array([[[40.0, 30.0]], [[40.0, 30.0]], [[-50.0, 30.0]]])  # the second covers the first
    radius, one = np.array([[5.0], [9.0], [4.0]]), np.ones((3, 1))
    color = np.array([[0.9, 0.1, 0.1], [0.2, 0.2, 0.2], [0.0, 0.0, 0.0]])
    canvas, target = np.full((HEIGHT, WIDTH, 3), 0.2), pictures(7)[1]
    hard = PixelStrokes(disc, radius, one, 0 * one, color)
    without, alone = (
        rise_without(hard, canvas, target, distances=(1, 2)),
        fall_with(hard, canvas, target, distances=(1, 2)),
    )
    np.testing.assert_allclose([without[0], without[2], alone[1], alone[2]], 0, atol=1e-12)
    assert abs(alone[0]) > 1
    assert without[1] == pytest.approx(-fall_with(hard.at([0]), canvas, target, distances=(1, 2))[0])  # bares the first


def test_stroke_effects_keep_the_canvas() -> None:
    canvas, target = pictures(8)
    before = canvas.copy()
    assert rise_without(strokes(0, 1), canvas, target, distances=(1,)).shape == (0,)
    rise_without(strokes(4, 1), canvas, target, distances=(1,))
    fall_with(strokes(4, 1), canvas, target, distances=(1,))
    np.testing.assert_array_equal(canvas, before)


@pytest.mark.parametrize("worth", [rise_without, fall_with])
def test_stroke_effects_reject_wrong_shapes(worth: Callable[..., np.ndarray]) -> None:
    lines, (canvas, target) = strokes(3, 1), pictures(2)
    with pytest.raises(RenderInputError, match=r"target of \(60, 90, 3\), float64: give both"):
        worth(lines, canvas, target[:60], distances=(1,))
    with pytest.raises(RenderInputError, match="radius must have shape"):
        worth(lines._replace(radius=lines.radius[:2]), canvas, target, distances=(1,))
    with pytest.raises(RenderInputError, match="takes sides up to 65535"):
        worth(lines, np.zeros((1, 65_536, 3)), np.zeros((1, 65_536, 3)), distances=(1,))
