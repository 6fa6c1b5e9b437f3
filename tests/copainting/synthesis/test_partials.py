"""Partial paintings: strokes on regions, and the removal strategies."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pentimento.copainting.synthesis.partials import (
    PartialsConfig,
    largest_labels,
    most_salient,
    on_region,
    partials,
    random_subset,
)

SIZE_M = (0.2, 0.1)
CONFIG = PartialsConfig(
    random=4, random_kept=(0.25, 0.75), salient_shares=(0.2, 0.4), semantic=3, min_inside_share=0.5, margin_m=0
)


def dashes(places_m: list[tuple[float, float]], length_m: float = 0.01) -> NDArray[np.float64]:
    """[S, 9, 2] short horizontal strokes about these places."""
    along = np.stack([np.linspace(-0.5, 0.5, 9) * length_m, np.zeros(9)], axis=-1)
    return np.array(places_m)[:, None] + along


def two_things() -> NDArray[np.uint8]:
    """[20, 40]: thing 1 at the canvas's upper left, the larger thing 2 at its lower right."""
    regions = np.zeros((20, 40), np.uint8)
    regions[1:6, 2:10], regions[12:19, 25:39] = 1, 2
    return regions


STROKES = dashes([(0.03, 0.083), (0.04, 0.08), (0.15, 0.02), (0.16, 0.03), (0.1, 0.05)])


def test_strokes_on_a_region_use_row_zero_as_the_canvas_top() -> None:
    regions = two_things()
    assert on_region(STROKES, regions == 1, SIZE_M, inside=0.5, margin_m=0.0).tolist() == [
        True,
        True,
        False,
        False,
        False,
    ]
    assert on_region(STROKES, regions == 2, SIZE_M, inside=0.5, margin_m=0.0).tolist() == [
        False,
        False,
        True,
        True,
        False,
    ]
    assert not on_region(
        STROKES, regions == 3, SIZE_M, inside=0.5, margin_m=0.05
    ).any()  # there is no such region: no margin either


def test_stroke_belongs_to_a_region_by_the_fraction_inside() -> None:
    half = dashes([(0.05, 0.083)], 0.02)  # thing 1 ends at x = 50 mm
    belongs = [
        bool(on_region(half, two_things() == 1, SIZE_M, inside=share, margin_m=0.0)[0])
        for share in (0.2, 0.4, 0.7, 1.0)
    ]
    assert belongs == [True, True, False, False]


def test_region_margin_is_in_metres() -> None:
    beside = dashes([(0.06, 0.083)], 0.001)  # 10 mm beside thing 1, two pixels
    assert not on_region(beside, two_things() == 1, SIZE_M, inside=1.0, margin_m=0.008)[0]
    assert on_region(beside, two_things() == 1, SIZE_M, inside=1.0, margin_m=0.016)[0]


def test_most_salient_part_has_the_requested_size() -> None:
    ramp = np.linspace(0, 1, 800).reshape(20, 40)
    chosen = most_salient(ramp, 0.25)
    assert abs(chosen.mean() - 0.25) < 0.01 and ramp[chosen].min() > ramp[~chosen].max()
    assert not most_salient(np.zeros((20, 40)), 0.25).any()


def test_largest_labels_are_sorted_by_size_without_background() -> None:
    assert largest_labels(two_things(), 5) == [2, 1]
    assert largest_labels(two_things(), 1) == [2]
    assert largest_labels(np.zeros((4, 4), np.uint8), 3) == []


@given(strokes=st.integers(2, 60), seed=st.integers(0, 1000))
def test_random_subset_keeps_a_fraction_within_bounds(strokes: int, seed: int) -> None:
    kept = random_subset(strokes, (0.25, 0.75), np.random.default_rng(seed))
    assert 1 <= kept.sum() < strokes
    assert 0.25 * strokes - 0.5 <= kept.sum() <= 0.75 * strokes + 0.5


def partials_of(regions: NDArray[np.uint8], seed: int = 0) -> list[tuple[str, int | None, list[bool]]]:
    saliency = np.zeros((20, 40))
    saliency[:, 10:26] = np.linspace(1, 2, 16)  # stroke 4 lies in its most salient half
    found = partials(STROKES, saliency, regions, SIZE_M, config=CONFIG, rng=np.random.default_rng(seed))
    return [(partial.strategy, partial.region, partial.kept.tolist()) for partial in found]


def test_partials_use_four_strategies_without_duplicates() -> None:
    found = partials_of(two_things())
    assert found[0] == ("all", None, [False] * 5)
    assert ("semantic", 2, [True, True, False, False, True]) in found
    assert {strategy for strategy, _, _ in found} == {"all", "random", "salient", "semantic"}
    keeping = [tuple(kept) for _, _, kept in found]
    assert len(set(keeping)) == len(keeping) and (True,) * 5 not in keeping
    assert found == partials_of(two_things())
    assert [f for f in found if f[0] == "random"] != [f for f in partials_of(two_things(), 1) if f[0] == "random"]


def test_semantic_partial_equal_to_all_is_left_out() -> None:
    found = partials_of(np.ones((20, 40), np.uint8))
    assert [strategy for strategy, _, kept in found if not any(kept)] == ["all"]
    assert "semantic" not in {strategy for strategy, _, _ in found}


def test_plan_without_strokes_has_no_partials() -> None:
    none = partials(
        np.zeros((0, 9, 2)), np.ones((20, 40)), two_things(), SIZE_M, config=CONFIG, rng=np.random.default_rng(0)
    )  # fmt: skip
    assert none == []


@pytest.mark.parametrize(
    ("field", "value"),
    [("random_kept", (0.0, 0.5)), ("random_kept", (0.6, 0.5)), ("salient_shares", (1.5,)), ("min_inside_share", 0.0)],
)
def test_rejects_partials_config_out_of_range(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=field):
        PartialsConfig(**(vars(CONFIG) | {field: value}))
