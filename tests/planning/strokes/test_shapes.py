"""Shapes of strokes: gradients against finite differences, files, and the same Bézier stroke by another way."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.latent import (
    Layer,
    StyleDecoder,
    read_decoder,
    write_decoder,
)
from pentimento.planning.strokes.shapes import BezierShapes, ShapedStrokes, Shapes
from pentimento.robots.tools import load_tool

MARKER = load_tool("marker")


def hand(points: int = 12, latent: int = 5, seed: int = 0) -> StyleDecoder:
    """A decoder of random weights whose strokes are about 3 cm long."""
    rng = np.random.default_rng(seed)
    sizes = [latent, 16, 16, 2 * points]
    layers = [
        Layer(rng.normal(0, 0.4, (a, b)).astype(np.float32), rng.normal(0, 0.2, b).astype(np.float32))
        for a, b in pairwise(sizes)
    ]
    straight = np.stack([np.linspace(0, 3, points), np.zeros(points)], axis=-1).ravel().astype(np.float32)
    layers[-1] = Layer(layers[-1].weight, straight)
    return StyleDecoder(
        "ann", tuple(layers), 0.01, rng.normal(0, 1, (6, latent)).astype(np.float32),
        np.full((6, latent), 0.1, np.float32),
    )  # fmt: skip


def strokes_of(shapes: Shapes, count: int = 3, seed: int = 1) -> ShapedStrokes:
    rng = np.random.default_rng(seed)
    parameters = shapes.sample(count, rng)
    fields = (
        rng.uniform(0.06, 0.1, (count, 2)), rng.uniform(-3, 3, count), rng.uniform(0, 1e-3, (count, 3)),
        np.zeros((count, 3)),
    )  # fmt: skip
    return ShapedStrokes(shapes, 0.5, parameters, parameters.copy(), *(field.astype(np.float32) for field in fields))


@pytest.mark.parametrize("shapes", [hand(), BezierShapes(MARKER, 12)], ids=["hand", "bezier"])
def test_shape_gradients_agree_with_finite_differences(shapes: Shapes) -> None:
    strokes = strokes_of(shapes)
    path, pull = strokes.placed()
    weights = np.random.default_rng(2).normal(size=path.shape).astype(np.float32)
    weights[..., [0, 4]] = 0
    for array, gradient in zip(strokes.arrays()[:-1], pull(weights), strict=True):
        assert array.shape == gradient.shape
        step = 1e-2 * max(float(np.abs(array).max()), 1e-3)
        for index in np.random.default_rng(3).permutation(array.size)[:4]:
            place = np.unravel_index(index, array.shape)
            kept, found = array[place], []
            for sign in (1, -1):
                array[place] = kept + sign * step
                found.append(float((strokes.placed()[0].astype(np.float64) * weights).sum()))
            array[place] = kept
            slope = (found[0] - found[1]) / (2 * step)
            assert gradient[place] == pytest.approx(slope, rel=0.03, abs=0.02 * float(np.abs(gradient).max()))


def test_bezier_shapes_agree_with_bezier_strokes() -> None:
    shapes = BezierShapes(MARKER, 12)
    strokes = strokes_of(shapes)
    cos, sin = np.cos(strokes.theta_rad), np.sin(strokes.theta_rad)
    lift = shapes._across.mean() * strokes.parameters[:, 1]  # a Bézier stroke's pose is that of its chord's middle
    middle = strokes.middle_m - np.stack([-sin * lift, cos * lift], axis=1)
    known = Strokes(
        middle, strokes.theta_rad, strokes.parameters[:, 0], strokes.parameters[:, 1], strokes.press_m, strokes.color
    )
    np.testing.assert_allclose(strokes.placed()[0], known.paths(12), atol=1e-7)


def test_shaped_strokes_stay_within_canvas_tool_and_reach() -> None:
    shapes = hand()
    strokes = strokes_of(shapes, 20)
    strokes.parameters += np.random.default_rng(4).normal(0, 5, strokes.parameters.shape).astype(np.float32)
    strokes.middle_m[:] = np.random.default_rng(5).uniform(-0.1, 0.3, (20, 2))
    strokes.press_m += 1
    strokes.keep_within(MARKER, (0.3, 0.2), 5e-3)
    assert (np.abs(strokes.parameters - strokes.start) <= 0.5 * shapes.spread * (1 + 1e-6)).all()
    path = strokes.placed()[0]
    assert path[..., 1].min() > 5e-3 - 1e-6
    assert path[..., 1].max() < 0.295 + 1e-6
    assert path[..., 2].max() < 0.195 + 1e-6
    assert strokes.press_m.max() == pytest.approx(MARKER.press_range_m[1])
    for planned in strokes.planned(MARKER, shapes.points):
        assert (np.diff(planned.path[:, 0]) > 0).all()
        assert planned.color_srgb.tolist() == [0, 0, 0]


def test_decoder_samples_around_demonstrations() -> None:
    shapes = hand()
    drawn = shapes.sample(4000, np.random.default_rng(0))
    np.testing.assert_allclose(drawn.std(0), shapes.spread, rtol=0.05)
    apart = np.linalg.norm(drawn[:, None] - shapes.latent_mean, axis=-1).min(1)
    assert np.median(apart) == pytest.approx(0.1 * np.sqrt(5), rel=0.15)


def test_decoder_file_round_trip(tmp_path: Path) -> None:
    path, known = tmp_path / "ann.npz", hand()
    write_decoder(path, known)
    first = path.read_bytes()
    write_decoder(path, known)
    assert path.read_bytes() == first
    found = read_decoder(path)
    latent = known.sample(3, np.random.default_rng(1))
    np.testing.assert_array_equal(found.decode(latent)[0], known.decode(latent)[0])
    assert (found.hand, found.points) == ("ann", 12)


def test_read_decoder_rejects_invalid_files(tmp_path: Path) -> None:
    path = tmp_path / "ann.npz"
    with pytest.raises(ContractError, match="holds no decoder"):
        read_decoder(path)
    path.write_bytes(b"PK nonsense")
    with pytest.raises(ContractError, match="holds no decoder"):
        read_decoder(path)
    odd = hand()
    write_decoder(path, StyleDecoder("ann", odd.layers[1:], 0.01, odd.latent_mean, odd.latent_deviation))
    with pytest.raises(ContractError, match="do not fit together"):
        read_decoder(path)
    with pytest.raises(ContractError, match="not finite"):
        write_decoder(path, StyleDecoder("ann", odd.layers, np.nan, odd.latent_mean, odd.latent_deviation))
