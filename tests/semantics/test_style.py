"""The style objective: gradients, invariance to position, and texture ranking."""

from functools import cache

import numpy as np
import pytest
import torch
from torch import Tensor

from pentimento.dynamics.strokes.photometry import linear_to_srgb
from pentimento.planning.objectives import PrintObjective
from pentimento.semantics.style import StyleObjective
from pentimento.semantics.style_features import LocalFeatures
from tests.semantics.test_earth_movers import earth_movers_distance
from tests.semantics.textures import equal_palette_crops, soft_blobs, texture_ranks

FEATURES = LocalFeatures()


@cache
def crops() -> dict[str, list[Tensor]]:
    return equal_palette_crops(192)


def test_style_gradient_equals_finite_differences() -> None:
    features = LocalFeatures().double()
    objective = StyleObjective(soft_blobs(40, 48, 1, torch.float64), features, 0)
    image = soft_blobs(40, 48, 0, torch.float64).requires_grad_(True)
    (gradient,) = torch.autograd.grad(objective(image), image)
    generator = torch.Generator().manual_seed(0)
    for _ in range(3):
        way = torch.randn(image.shape, dtype=torch.float64, generator=generator)
        with torch.no_grad():
            ends = [objective(image + step * way) for step in (-1e-6, 1e-6)]
        assert float((ends[1] - ends[0]) / 2e-6) == pytest.approx(float((gradient * way).sum()), rel=1e-4)


def test_style_objective_of_the_style_picture_is_zero() -> None:
    image = soft_blobs(64, 96, 0)
    assert float(StyleObjective(image, FEATURES, 0)(image)) == 0
    assert float(StyleObjective(soft_blobs(64, 96, 1) ** 2, FEATURES, 0)(image)) > 0.05


def test_style_objective_does_not_depend_on_earlier_calls() -> None:
    fresh, used = (StyleObjective(soft_blobs(64, 96, 1) ** 2, FEATURES, 0) for _ in range(2))
    for seed in range(12):
        used(soft_blobs(64, 96, seed))
    assert float(used(soft_blobs(64, 96, 20))) == pytest.approx(float(fresh(soft_blobs(64, 96, 20))), rel=1e-6)


def test_style_objective_ignores_positions() -> None:
    image = crops()["gravel"][0]
    swapped = torch.cat([image[:, 96:], image[:, :96]], 1)  # whole cells change places; only their seams differ
    moved, other = (float(StyleObjective(image, FEATURES, 0)(crop)) for crop in (swapped, crops()["gravel"][1]))
    assert moved < 0.25 * other
    near = PrintObjective(image.numpy(), (1,))
    assert near(swapped.numpy())[0] > 0.8 * near(crops()["gravel"][1].numpy())[0]


def test_style_objective_draws_cells_by_seed_for_other_sizes() -> None:
    image, style = soft_blobs(96, 96, 0), soft_blobs(64, 80, 1)
    first, second, other = (StyleObjective(style, FEATURES, seed) for seed in (0, 0, 1))
    values = [float(first(image)) for _ in range(4)]
    assert [float(second(image)) for _ in range(4)] == values
    assert len({*values, float(other(image))}) == 5


def test_style_ranks_crops_of_one_texture_nearest() -> None:
    """Every crop holds exactly the same greys, so that colour statistics cannot tell; the margin is large."""
    sets = {name: [FEATURES(crop) for crop in of_one] for name, of_one in crops().items()}
    style = texture_ranks(sets, lambda a, b: float(earth_movers_distance(a, b)))
    moments = {name: [_color_moments(crop) for crop in of_one] for name, of_one in crops().items()}
    palette = texture_ranks(moments, lambda a, b: float((a - b).norm()))
    print(f"triplets ranked right: style {style}, colour mean and covariance {palette}")
    assert min(style.values()) > 0.85
    assert np.mean(list(style.values())) > 0.95
    assert np.mean(list(palette.values())) < 0.7


def _color_moments(image: Tensor) -> Tensor:
    colors = linear_to_srgb(image).reshape(-1, 3)
    return torch.cat([colors.mean(0), torch.cov(colors.T).flatten()])


def test_pixel_descent_on_the_style_objective_transfers_style() -> None:
    start, style = crops()["brick"][0], crops()["grass"][0]
    objective = StyleObjective(style, FEATURES, 0)
    image = start.clone().requires_grad_(True)
    adam = torch.optim.Adam([image], lr=0.02)
    for _ in range(15):
        adam.zero_grad()
        objective(image).backward()
        adam.step()
        with torch.no_grad():
            image.clamp_(0, 1)
    after = float(objective(image.detach()))
    assert after < 0.6 * float(objective(start))
    unseen = StyleObjective(crops()["grass"][3], FEATURES, 0)  # another piece of grass: style, not this crop
    assert float(unseen(image.detach())) < 0.7 * float(unseen(start))
