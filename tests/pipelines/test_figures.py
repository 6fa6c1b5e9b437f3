"""Which figure is better, and is it luck: on figures whose truth is known."""

import numpy as np
import pytest

from pipelines._review.figures import Figure, figures, less_is_better, paired


def only(a: dict[str, float], b: dict[str, float]) -> Figure:
    (figure,) = figures(a, b)
    return figure


@pytest.mark.parametrize(
    ("name", "less"),
    [
        ("held_out.model.mse", True),
        ("error.with_replanning", True),
        ("held_out.model.iou", False),
        ("main.picture.objects.recognised", False),
        ("sim2real_mse.model", True),
        ("sim2real_factor", False),
        ("table.fine_tuned.judge_score.value", False),
        ("train_stroke_dynamics/marker/held_out.model.mse", True),
        ("held_out.polyline.mse", None),
        ("main.picture.objects.chance", None),
        ("strokes.held_out", None),
    ],
)
def test_a_figure_says_by_its_name_whether_less_is_better(name: str, less: bool | None) -> None:
    assert less_is_better(name) is less


def test_the_better_side_follows_the_direction() -> None:
    assert only({"x.mse": 1.0}, {"x.mse": 2.0}).better == "A"
    assert only({"x.iou": 1.0}, {"x.iou": 2.0}).better == "B"
    assert only({"rows": 1.0}, {"rows": 2.0}).better is None
    assert not only({"x.mse": 1.0}, {"x.mse": 1.0 + 1e-12}).changed


def test_without_an_interval_nothing_is_said_of_luck() -> None:
    figure = only({"x.mse": 1.0}, {"x.mse": 2.0})
    assert figure.beyond_luck is None
    assert figure.sentence == "A is better; no interval recorded, so luck is not ruled out"
    assert only({"x.mse": 1.0}, {}).sentence == "in one run only"


@pytest.mark.parametrize(("low", "high", "sure"), [(1.6, 2.4, True), (1.1, 2.9, False)])
def test_recorded_intervals_decide_by_their_overlap(low: float, high: float, sure: bool) -> None:
    a = {"x.mse.value": 1.0, "x.mse.low": 0.7, "x.mse.high": 1.3}
    b = {"x.mse.value": 2.0, "x.mse.low": low, "x.mse.high": high}
    figure = only(a, b)
    assert figure.intervals == ((0.7, 1.3), (low, high))
    assert figure.beyond_luck is sure
    assert ("beyond luck" if sure else "may be luck") in figure.sentence


def test_bounds_beside_a_plain_name_are_no_figures_of_their_own() -> None:
    assert [each.name for each in figures({"gain": 1.0, "gain_low": 0.5, "gain_high": 1.5, "low": 3.0}, {})] == [
        "gain",
        "low",
    ]


def test_pairing_sees_what_overlapping_intervals_hide_and_nothing_where_nothing_is() -> None:
    """Items differ by far more than runs do: only their differences tell, and those of a mere shuffle do not."""
    rng = np.random.default_rng(0)
    items = rng.normal(10, 3, 30)
    shifted = items + 0.2 + rng.normal(0, 0.1, 30)
    figure = only({"x.mse": float(items.mean())}, {"x.mse": float(shifted.mean())})
    found = paired(figure, items.tolist(), shifted.tolist(), 0)
    assert found.beyond_luck and found.better == "A" and found.paired is not None
    assert found.paired.low < 0.2 < found.paired.high and "paired over 30" in found.sentence
    wrong = sum(
        bool(
            paired(
                figure, items.tolist(), (items + np.random.default_rng(n).normal(0, 0.1, 30)).tolist(), 0
            ).beyond_luck
        )
        for n in range(60)
    )
    assert wrong <= 9  # 5 % nominal; the bootstrap of 30 items errs in a few more


def test_too_few_items_or_other_ones_are_not_paired() -> None:
    figure = only({"x.mse": 1.0}, {"x.mse": 2.0})
    few = paired(figure, [1.0] * 5, [2.0] * 5, 0)
    assert few.paired is None and few.beyond_luck is None
    assert "an interval needs 6 held-out items and there are 5, so luck is not ruled out" in few.sentence
    assert "the numbers of held-out items differ" in paired(figure, [1.0] * 8, [2.0] * 7, 0).sentence
