"""Objectives: distances of sets obey the laws of distances, and style is what textures share and others lack."""

import itertools
from functools import cache

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.planning.objectives.earth_movers import (
    best_partners,
    earth_movers_distance,
    fair_prices,
    ways_between,
)
from pentimento.planning.objectives.features import CELL_PX, OPPONENT, LocalFeatures, cell_means, gabor_bank
from pentimento.planning.objectives.print_objective import PrintObjective
from pentimento.planning.objectives.style import StyleObjective
from pentimento.planning.objectives.weighted import Term, WeightedObjective
from pentimento.stroke_dynamics.photometry import linear_to_srgb
from tests.planning.textures import equal_palette_crops, texture_ranks

FEATURES = LocalFeatures()


def points(count: int, dimensions: int, seed: int) -> Tensor:
    return torch.randn(count, dimensions, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def picture(height: int, width: int, seed: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Soft blobs of colour."""
    rng = np.random.default_rng(seed)
    soft = cv2.GaussianBlur(rng.normal(size=(height, width, 3)), (0, 0), 2.0)
    return torch.tensor(0.5 + 0.4 * soft / np.abs(soft).max(), dtype=dtype)


@cache
def crops() -> dict[str, list[Tensor]]:
    return equal_palette_crops(192)


# The Earth Mover's Distance


@pytest.mark.parametrize(("count", "dimensions"), [(1, 3), (40, 1), (60, 12)])
def test_the_distance_of_sets_is_a_metric(count: int, dimensions: int) -> None:
    a, b, c = (points(count, dimensions, seed) for seed in range(3))
    assert float(earth_movers_distance(a, a)) == 0
    assert float(earth_movers_distance(a, b)) > 0
    torch.testing.assert_close(earth_movers_distance(a, b), earth_movers_distance(b, a))
    way, detour = earth_movers_distance(a, c), earth_movers_distance(a, b) + earth_movers_distance(b, c)
    assert float(way) <= float(detour) + 1e-12


def test_a_set_has_no_order() -> None:
    a, b = points(50, 4, 0), points(50, 4, 1)
    shuffled = a[torch.randperm(50, generator=torch.Generator().manual_seed(2))]
    assert float(earth_movers_distance(a, shuffled)) == 0
    torch.testing.assert_close(earth_movers_distance(shuffled, b), earth_movers_distance(a, b))


def test_on_a_line_it_is_the_difference_of_the_sorted() -> None:
    a, b = points(80, 1, 0), 2 * points(80, 1, 1) + 0.3
    expected = (a.sort(0).values - b.sort(0).values).abs().mean()
    torch.testing.assert_close(earth_movers_distance(a, b), expected)


def test_a_displaced_set_lies_as_far_as_it_was_displaced() -> None:
    a, step = points(50, 3, 0), torch.tensor([0.3, -0.4, 1.2], dtype=torch.float64)
    torch.testing.assert_close(earth_movers_distance(a, a + step), step.norm())  # no pairing beats the mean's way


def test_few_points_by_trying_every_pairing() -> None:
    a, b = points(6, 2, 3), points(6, 2, 4)
    least = min(float((a - b[list(order)]).norm(dim=1).mean()) for order in itertools.permutations(range(6)))
    assert float(earth_movers_distance(a, b)) == pytest.approx(least, rel=1e-12)


def test_prices_change_no_pairing() -> None:
    ways = ways_between(points(60, 3, 0), points(60, 3, 1))
    partners = best_partners(ways)
    for prices in (fair_prices(ways, partners), np.random.default_rng(0).normal(size=60)):
        np.testing.assert_array_equal(best_partners(ways, prices), partners)


def test_fair_prices_prove_the_pairing_best() -> None:
    """Strong duality: no pairing costs less than what the rows' cheapest offers and the prices add up to."""
    ways = ways_between(points(60, 3, 0), points(60, 3, 1))
    partners = best_partners(ways)
    prices = fair_prices(ways, partners)
    bound = (ways - prices).min(axis=1).sum() + prices.sum()
    assert float(ways[np.arange(60), partners].sum()) == pytest.approx(bound, rel=1e-9)
    np.testing.assert_allclose((ways - prices)[np.arange(60), partners], (ways - prices).min(axis=1), atol=1e-8)


def test_the_gradient_of_the_distance_is_that_of_finite_differences() -> None:
    a, b = points(12, 3, 0).requires_grad_(True), points(12, 3, 1).requires_grad_(True)
    assert torch.autograd.gradcheck(earth_movers_distance, (a, b))


def test_sets_that_coincide_have_a_finite_gradient() -> None:
    a = points(5, 3, 0).requires_grad_(True)
    (gradient,) = torch.autograd.grad(earth_movers_distance(a, a.detach()), a)
    assert float(gradient.abs().max()) == 0


@pytest.mark.parametrize("others", [(4, 3), (5, 2), (5,)])
def test_sets_of_other_shapes_are_refused(others: tuple[int, ...]) -> None:
    with pytest.raises(ContractError, match=r"shapes \(5, 3\) and .* have no pairing"):
        earth_movers_distance(torch.zeros(5, 3), torch.zeros(others))


def test_a_point_that_is_not_finite_is_named() -> None:
    broken = points(5, 3, 0)
    broken[3, 1] = float("nan")
    with pytest.raises(ContractError, match=r"distance of point 3 to point 0 is nan"):
        ways_between(broken, points(5, 3, 1))


# The local features


def test_filters_see_no_uniform_light_and_give_a_grating_its_amplitude_at_every_phase() -> None:
    bank = gabor_bank(4).double()[:, 0]
    assert float(bank.sum((1, 2)).abs().max()) < 1e-6
    steps = torch.arange(7, dtype=torch.float64) - 3
    y, x = torch.meshgrid(steps, steps, indexing="ij")
    for index, turn in enumerate(np.pi * np.arange(4) / 4):
        for phase in np.linspace(0, np.pi, 7):
            grating = torch.cos(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / 4 + phase)
            modulus = (bank * grating).sum((1, 2)).unflatten(0, (4, 2)).norm(dim=1)
            assert float(modulus[index]) == pytest.approx(1, abs=0.02)
            assert int(modulus.argmax()) == index


def test_a_uniform_picture_has_its_colour_and_no_contrast() -> None:
    color = torch.tensor([0.5, 0.2, 0.05])
    cells = FEATURES(color.expand(50, 70, 3))
    assert cells.shape == (3 * 4, 49)
    opponent = torch.tensor(OPPONENT) @ linear_to_srgb(color)
    torch.testing.assert_close(cells[:, :3], opponent.expand(12, 3))
    assert float(cells[:, 3:].abs().max()) < 1e-5


@pytest.mark.parametrize("period", [4, 8, 16, 32])
def test_each_scale_answers_its_own_period_and_orientation(period: int) -> None:
    wave = 0.5 + 0.2 * torch.cos(2 * np.pi * (torch.arange(192) + 0.5) / period)
    upright = (wave**2.2)[None, :, None].expand(192, 192, 3)  # about a cosine in sRGB
    contrast = FEATURES(upright).reshape(12, 12, 49)[3:9, 3:9, 9:].mean((0, 1))
    light = torch.stack([contrast[0:4], contrast[4:8], contrast[16:20], contrast[28:32]])  # by scale, then orientation
    assert divmod(int(light.argmax()), 4) == (int(np.log2(period / 4)), 0)
    turned = FEATURES(upright.transpose(0, 1)).reshape(12, 12, 49)[3:9, 3:9, 9:].mean((0, 1))
    torch.testing.assert_close(turned[[0, 1, 2, 3]], contrast[[2, 1, 0, 3]], rtol=1e-3, atol=1e-4)


def test_dark_blue_on_light_yellow_is_not_light_blue_on_dark_yellow() -> None:
    """Both have nearly the same mean and contrasts of light and of colour; it is their going together that differs."""
    sign = torch.tensor(np.random.default_rng(0).choice([-1.0, 1.0], (24, 24)), dtype=torch.float32)
    sign = sign.repeat_interleave(8, 0).repeat_interleave(8, 1)[..., None]
    light, yellow = torch.tensor([0.12, 0.12, 0.12]), torch.tensor([0.06, 0.06, -0.12])
    with_, against = ((0.5 + sign * (light + turn * yellow)) ** 2.2 for turn in (1, -1))
    one, other = (FEATURES(image).mean(0) for image in (with_, against))
    together = (one - other)[3:9].abs().max()
    assert float(together) > 0.1
    rest = torch.cat([(one - other)[:3], (one - other)[9:]]).abs().max()
    assert float(rest) < 0.25 * float(together)


@pytest.mark.parametrize(("height", "width"), [(16, 16), (17, 31), (150, 203)])
def test_odd_and_small_pictures_are_covered_to_the_last_pixel(height: int, width: int) -> None:
    image = picture(height, width, 0).requires_grad_(True)
    cells = FEATURES(image)
    assert len(cells) == round(height / CELL_PX) * round(width / CELL_PX)
    (gradient,) = torch.autograd.grad(cells.square().sum(), image)
    assert bool((gradient.abs().amax(-1) > 0).all())


def test_means_over_cells_keep_the_mean() -> None:
    maps = points(7, 11, 0)
    torch.testing.assert_close(cell_means(maps, (3, 4)).mean(), maps.mean())
    torch.testing.assert_close(cell_means(maps, (7, 11)), maps)


def test_a_picture_smaller_than_a_cell_is_a_sentence() -> None:
    with pytest.raises(ConfigError, match=r"15 x 40 px has no local features: .*16 px or more"):
        FEATURES(torch.zeros(15, 40, 3))


# The style objective


def test_the_style_gradient_is_that_of_finite_differences() -> None:
    features = LocalFeatures().double()
    objective = StyleObjective(picture(40, 48, 1, torch.float64), features, 0)
    image = picture(40, 48, 0, torch.float64).requires_grad_(True)
    (gradient,) = torch.autograd.grad(objective(image), image)
    generator = torch.Generator().manual_seed(0)
    for _ in range(3):
        way = torch.randn(image.shape, dtype=torch.float64, generator=generator)
        with torch.no_grad():
            ends = [objective(image + step * way) for step in (-1e-6, 1e-6)]
        assert float((ends[1] - ends[0]) / 2e-6) == pytest.approx(float((gradient * way).sum()), rel=1e-4)


def test_a_picture_has_its_own_style() -> None:
    image = picture(64, 96, 0)
    assert float(StyleObjective(image, FEATURES, 0)(image)) == 0
    assert float(StyleObjective(picture(64, 96, 1) ** 2, FEATURES, 0)(image)) > 0.05


def test_what_was_asked_before_changes_no_answer() -> None:
    fresh, used = (StyleObjective(picture(64, 96, 1) ** 2, FEATURES, 0) for _ in range(2))
    for seed in range(12):
        used(picture(64, 96, seed))
    assert float(used(picture(64, 96, 20))) == pytest.approx(float(fresh(picture(64, 96, 20))), rel=1e-6)


def test_style_does_not_ask_where() -> None:
    image = crops()["gravel"][0]
    swapped = torch.cat([image[:, 96:], image[:, :96]], 1)  # whole cells change places; only their seams differ
    moved, other = (float(StyleObjective(image, FEATURES, 0)(crop)) for crop in (swapped, crops()["gravel"][1]))
    assert moved < 0.25 * other
    near = PrintObjective(image, (1,))
    assert float(near(swapped)) > 0.8 * float(near(crops()["gravel"][1]))


def test_pictures_of_other_sizes_are_compared_by_draws_that_the_seed_repeats() -> None:
    image, style = picture(96, 96, 0), picture(64, 80, 1)
    first, second, other = (StyleObjective(style, FEATURES, seed) for seed in (0, 0, 1))
    values = [float(first(image)) for _ in range(4)]
    assert [float(second(image)) for _ in range(4)] == values
    assert len({*values, float(other(image))}) == 5


def test_crops_of_a_texture_are_nearer_than_another_texture_of_the_same_palette() -> None:
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


def test_moving_pixels_down_the_style_objective_brings_the_style() -> None:
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


# Sums


def test_a_sum_weighs_values_and_gradients() -> None:
    image, target = picture(32, 48, 0).requires_grad_(True), picture(32, 48, 1)
    near, far = PrintObjective(target, (1,)), PrintObjective(target, (8,))
    both = WeightedObjective((Term("near", 0.5, near), Term("far", 3.0, far)))
    values = both.values(image)
    assert list(values) == ["near", "far"]
    torch.testing.assert_close(values["far"], far(image))
    torch.testing.assert_close(both(image), 0.5 * near(image) + 3 * far(image))
    torch.testing.assert_close(both.total(values), both(image))
    sum_, one, other = (torch.autograd.grad(f(image), image)[0] for f in (both, near, far))
    torch.testing.assert_close(sum_, 0.5 * one + 3 * other)


def test_a_term_without_weight_is_not_computed() -> None:
    def fails(image: Tensor) -> Tensor:
        raise AssertionError

    kept = Term("print", 1.0, lambda image: image.sum())
    assert list(WeightedObjective((kept, Term("style", 0.0, fails))).values(torch.ones(2))) == ["print"]


@pytest.mark.parametrize(
    ("weights", "names", "sentence"),
    [
        ((0.0, 0.0), "ab", "No objective of"),
        ((1.0, -1.0), "ab", "each must be 0 or more"),
        ((1.0, float("nan")), "ab", "each must be 0 or more"),
        ((1.0, 1.0), "aa", "share a name"),
    ],
)
def test_sums_that_mean_nothing_are_refused(weights: tuple[float, float], names: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        WeightedObjective(tuple(Term(name, weight, torch.sum) for name, weight in zip(names, weights, strict=True)))
