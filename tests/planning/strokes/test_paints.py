"""Paints and the order of painting."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.colour import delta_e_2000, srgb_to_lab
from pentimento.contracts.errors import ConfigError
from pentimento.planning.strokes.descent import optimise
from pentimento.planning.strokes.paints import (
    Paints,
    choose_paints,
    in_order,
    overlaps,
    repaint,
    sweep_order,
    visible,
)
from pentimento.planning.strokes.palette import PaletteChoice, cluster_palette, picture_palette, salient_palette
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.render_plan import coverages
from tests.planning.strokes.scenes import (
    CONFIG,
    INK,
    WHITE,
    loss,
    scene,
    strokes_at,
    unheard,
)

FOUR = ((0.9, 0.9, 0.85), (0.7, 0.2, 0.2), (0.2, 0.5, 0.3), (0.1, 0.1, 0.1))


def paint_changes(paint: np.ndarray) -> int:
    """How often the brush is washed."""
    return int(np.count_nonzero(np.diff(paint)))


def random_layers(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    covers = np.zeros((30, 50))
    for cover in covers:
        start = rng.integers(0, 40)
        cover[start : start + rng.integers(2, 12)] = 1.0
    paint = rng.integers(0, 4, 30)
    return covers, np.array(FOUR)[paint], paint


def composed(covers: np.ndarray, colors: np.ndarray, order: np.ndarray) -> np.ndarray:
    image = np.ones((covers.shape[1], 3))
    for s in order:
        image += covers[s][:, None] * (colors[s] - image)
    return image


@pytest.mark.parametrize("seed", range(5))
def test_many_sweeps_keep_the_picture_and_lower_paint_changes(seed: int) -> None:
    covers, colors, paint = random_layers(seed)
    order = sweep_order(covers, colors, paint, sweeps=30)
    np.testing.assert_allclose(composed(covers, colors, order), composed(covers, colors, np.arange(30)))
    assert paint_changes(paint[order]) < paint_changes(paint)


@pytest.mark.parametrize("seed", range(5))
def test_fewer_sweeps_trade_error_for_paint_changes(seed: int) -> None:
    covers, colors, paint = random_layers(seed)
    as_laid = composed(covers, colors, np.arange(30))
    error, changes = [], []
    for sweeps in (1, 2, 30):
        order = sweep_order(covers, colors, paint, sweeps)
        assert sorted(order) == list(range(30))
        falls = np.count_nonzero(np.diff(paint[order]) < 0)  # from a darker paint back to a lighter one
        assert falls <= sweeps - 1
        error.append(np.square(composed(covers, colors, order) - as_laid).mean())
        changes.append(paint_changes(paint[order]))
    assert error[0] > error[2]
    assert changes == sorted(changes)


def test_visible_shares_sum_to_one_with_the_canvas() -> None:
    covers = np.random.default_rng(0).uniform(0, 1, (6, 10))
    np.testing.assert_allclose(visible(covers).sum(0) + np.prod(1 - covers, axis=0), 1)


def test_overlap_counts_between_different_colours_only() -> None:
    covers, colors = np.ones((3, 4)), np.array([[1.0, 1, 1], [0, 0, 0], [0, 0, 0]])
    shows = overlaps(covers, colors)
    np.testing.assert_allclose(shows, [[0, 0, 12], [0, 0, 0], [0, 0, 0]])  # the second lies hidden under the third


def test_coverage_sums_to_the_stroke_area() -> None:
    """ρ(1 − d/R)^c integrates to 2Rρ/(c + 1) across the path, and to 2πR²ρ/((c + 1)(c + 2)) round both ends."""
    places = np.random.default_rng(0).uniform((0.04, 0.03), (0.08, 0.05), (200, 2))
    covers = coverages(strokes_at(*((float(x), float(y)) for x, y in places)), scene(), 60)
    assert covers.shape == (200, 60 * 40)
    radius, density, softness = 3e-3, 0.95, 0.2  # at contact 2 mm, and 1 mm of press
    ends = 2 * np.pi * radius**2 / ((softness + 1) * (softness + 2))
    area_m2 = density * (2 * radius / (softness + 1) * 0.02 + ends)
    assert covers.sum(1).mean() * (0.12 / 60) ** 2 == pytest.approx(
        area_m2, rel=0.04
    )  # 1.5 px wide: the rim is not resolved


@pytest.mark.parametrize(
    ("choice", "count"),
    [
        (PaletteChoice("plan", 3, None, None), 3),
        (PaletteChoice("picture", 4, "chelsea", None), 4),
        (PaletteChoice("given", None, None, FOUR), 4),
    ],
)
def test_palettes_are_sorted_and_used_by_the_plan(choice: PaletteChoice, count: int) -> None:
    palette = plan(WHITE, scene(), 24, replace(CONFIG, palette=choice), unheard)[1]
    assert len(palette) <= count
    assert (np.diff(srgb_to_lab(palette)[:, 0]) <= 1e-9).all()
    if choice.colors_srgb is not None:
        np.testing.assert_allclose(palette, sorted(FOUR, key=lambda c: -srgb_to_lab(np.array(c))[0]), atol=1e-6)


def test_picture_palette_has_the_pictures_colours() -> None:
    palette = picture_palette("chelsea", 5, 0)
    assert palette.shape == (5, 3)
    assert (palette[:, 0] > palette[:, 2]).mean() > 0.7  # a ginger cat


def test_repaint_never_raises_the_loss() -> None:
    strokes = strokes_at((0.03, 0.03), (0.08, 0.03), (0.05, 0.06), (0.085, 0.03))
    choice = PaletteChoice("given", None, None, ((0.8, 0.25, 0.25), (0.25, 0.66, 0.35)))
    paints = choose_paints(strokes, scene(), choice, 0)
    wrong = replace(paints, index=1 - paints.index)
    before = wrong.dipped(strokes)
    after, chosen = repaint(before, wrong, WHITE, scene(), config=CONFIG)
    assert loss(after, WHITE) < loss(before, WHITE)
    again, _ = repaint(after, chosen, WHITE, scene(), config=CONFIG)
    assert loss(again, WHITE) <= loss(after, WHITE)


def test_in_order_keeps_colours() -> None:
    strokes = strokes_at((0.03, 0.03), (0.08, 0.03), (0.05, 0.06), (0.085, 0.03))
    paints = Paints(np.array([[0.1, 0.1, 0.1], [0.8, 0.8, 0.8]], np.float32), np.array([0, 1, 0, 1]), np.zeros(2, bool))
    ordered, sorted_paints = in_order(paints.dipped(strokes), paints, scene(), replace(CONFIG, sweeps=1))
    np.testing.assert_allclose(sorted_paints.linear[sorted_paints.index], ordered.color, rtol=1e-5)
    np.testing.assert_allclose(ordered.color[:, 0], [0.8, 0.8, 0.1, 0.1], rtol=1e-5)


def test_palette_rejects_wrong_tool_and_fields() -> None:
    with pytest.raises(ConfigError, match=r"source is plan, but the marker brings its own ink: .*ink"):
        plan(WHITE, scene("marker"), 5, CONFIG, unheard)
    with pytest.raises(ConfigError, match=r"source is ink, but the round_brush brings none"):
        plan(WHITE, scene(), 5, INK, unheard)
    for wrong, sentence in (
        (("plan", None, None, None), r"^size is None; a palette from plan takes size"),
        (("given", 3, None, FOUR), r"^size is 3; a palette from given takes colors_srgb"),
        (("ink", None, "chelsea", None), r"^picture is 'chelsea'; .* takes nothing else"),
        (("plan", 0, None, None), r"^size is 0; it must be 1"),
        (("given", None, None, ((2.0, 0.0, 0.0),)), r"^colors_srgb has \[2\.0"),
        (("given", None, None, ()), r"^colors_srgb is empty"),
    ):
        with pytest.raises(ValueError, match=sentence):
            PaletteChoice(*wrong)  # type: ignore[arg-type]


GREEN_EYES = (0.40, 0.47, 0.20)


def browns_with_eyes(eyes: int) -> tuple[np.ndarray, np.ndarray]:
    """Two hundred browns from dark to light, then a few small strokes of green; and the area of each."""
    rng = np.random.default_rng(0)
    light = np.linspace(0.2, 0.9, 200)[:, None]
    browns = light * (0.75, 0.55, 0.4) + rng.normal(0, 0.015, (200, 3))
    greens = np.array(GREEN_EYES) + rng.normal(0, 0.01, (eyes, 3))
    return np.concatenate([browns, greens]), np.concatenate([np.ones(200), np.full(eyes, 0.12)])


def distance(palette: np.ndarray, color: tuple[float, float, float]) -> float:
    return float(delta_e_2000(srgb_to_lab(palette), srgb_to_lab(np.array(color))).min())


def test_small_salient_colour_keeps_a_paint() -> None:
    """Strokes vote for paints; eyes of .3 % of the area have no vote, and keep their green all the same."""
    colors, areas = browns_with_eyes(4)
    assert distance(cluster_palette(colors, areas, 6, 0)[0], GREEN_EYES) > 12
    palette, index, fixed = salient_palette(colors, areas, 6, 0)
    assert len(palette) == 6 and fixed.sum() >= 1
    assert distance(palette[fixed], GREEN_EYES) < 3
    assert len(set(index[-4:])) == 1 and fixed[index[-1]]
    assert (np.diff(srgb_to_lab(palette)[:, 0]) <= 0).all()


def test_salient_paints_leave_the_others_nearly_as_good() -> None:
    """The error of the other colours is about that of a palette with as many paints less."""
    colors, areas = browns_with_eyes(4)

    def error(palette: np.ndarray) -> float:
        squares = np.square(srgb_to_lab(colors[:200])[:, None] - srgb_to_lab(palette)).sum(-1).min(1)
        return float(areas[:200] @ squares)

    palette, _, fixed = salient_palette(colors, areas, 8, 0)
    fewer = cluster_palette(colors[:200], areas[:200], 8 - int(fixed.sum()), 0)[0]
    assert error(palette) <= 1.1 * error(fewer)


def test_no_salient_colour_no_fixed_paint() -> None:
    colors, areas = browns_with_eyes(0)
    palette, index, fixed = salient_palette(colors, areas, 12, 0)
    assert not fixed.any()
    few = np.repeat(np.array([GREEN_EYES, (0.8, 0.1, 0.1)]), 5, axis=0)
    assert len(salient_palette(few, np.ones(10), 12, 0)[0]) == 2
    assert len(salient_palette(few, np.ones(10), 1, 0)[0]) == 1
    assert index.max() < len(palette)


def test_descent_leaves_fixed_paints() -> None:
    strokes = strokes_at((0.03, 0.03), (0.08, 0.03), (0.05, 0.06), (0.085, 0.03))
    linear = np.array([[0.5, 0.5, 0.5], [0.3, 0.3, 0.3]], np.float32)
    paints = Paints(linear.copy(), np.array([0, 1, 0, 1]), np.array([False, True]))
    optimise(
        paints.dipped(strokes), WHITE, scene(), CONFIG, iterations=5, free_color=True, rate=1.0, log=unheard,
        paints=paints,
    )  # fmt: skip
    np.testing.assert_array_equal(paints.linear[1], linear[1])
    assert np.abs(paints.linear[0] - linear[0]).max() > 0.01


def test_given_paints_stay_as_they_are_however_dark() -> None:
    given = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    blot = replace(scene(), target=np.zeros_like(WHITE))
    _, palette = plan(WHITE, blot, 4, replace(CONFIG, palette=PaletteChoice("given", None, None, given)), unheard)
    assert np.abs(palette[:, None] - np.array(given)).max(-1).min(1) == pytest.approx(np.zeros(len(palette)), abs=1e-6)
