"""The score card and page of the blind benchmark, for both kinds."""

from typing import Any

import pytest

from studies.blind.binomial import Bar, falls_short, interval, standing
from studies.blind.kinds import kind_of
from studies.blind.page import page
from studies.blind.score_card import (
    Row,
    covariate_found,
    error_removed,
    exact,
    in_rival_set,
    outside_found,
    rows,
    unique_and_right,
    wrong_unique,
)

Line = dict[str, Any]
STROKES, PUSHES = kind_of("strokes"), kind_of("pushes")


def verdict(
    *named: tuple[str, list[str]],
    left: tuple[str, str] | None = None,
    reached: bool = True,
    closed: float | None = 0.95,
) -> dict[str, Any]:
    entries = [{"cause": cause, "rivals": rivals, "gain": 0.5, "probability": 0.97} for cause, rivals in named]
    return {
        "established": entries, "suspected": [], "floor_reached": reached, "mse": {"base": 3e-4, "floor": 1e-4},
        "gap_closed": {"test": closed, "ci": None, "shifted": None},
        "unexplained": [{"mode": left[0], "covariate": left[1]}] if left else [],
    }  # fmt: skip


def line(series: str, causes: list[str], verdict_: dict[str, Any] | None, index: int = 0, **more: Any) -> Line:
    outside = more.pop("outside", None)
    truth = {
        "causes": causes, "outside": outside, "tool": "marker", "wanted_q": [0.2] * len(causes),
        "strengths": [{"q": 0.2}] * len(causes),
    }  # fmt: skip
    fields = {"series": series, "index": index, "seed": index, "truth": truth, "code": "c", "seconds": 2.0, **more}
    return fields | (
        {"failed": "lost"} if verdict_ is None else {"verdict": verdict_, "rivals": {"pixels": ["backlash"]}}
    )


LAG = ("bristle_lag", list[str]())


def row_of(lines: list[Line], what: str) -> Row:
    (found,) = (row for row in rows(STROKES, lines) if what in row.what)
    return found


def test_exact_set_has_no_missing_and_no_additional_cause() -> None:
    both = ("latency", list[str]())
    assert exact(line("one cause", ["bristle_lag"], verdict(LAG)))
    assert exact(line("two causes", ["latency", "bristle_lag"], verdict(LAG, both)))
    assert not exact(line("two causes", ["latency", "bristle_lag"], verdict(LAG)))
    assert not exact(line("one cause", ["bristle_lag"], verdict(LAG, both)))
    assert not exact(line("none", [], None))  # a missing verdict is not exact


@pytest.mark.parametrize(
    ("column", "verdict_", "right"),
    [
        ("humidity", verdict(left=("normal", "humidity")), True),
        ("humidity", verdict(left=("width", "humidity")), False),
        ("humidity", verdict(left=("normal", "battery_v")), False),
        ("humidity", verdict(), False),
        ("hidden", verdict(reached=False), True),
        ("hidden", verdict(reached=True), False),
        ("hidden", verdict(LAG, reached=False), False),
        ("hidden", verdict(left=("normal", "humidity"), reached=False), False),
        ("hidden", None, False),
    ],
)
def test_outside_effect_needs_mode_and_covariate(column: str, verdict_: dict[str, Any] | None, right: bool) -> None:
    assert outside_found(line("outside", [], verdict_, outside={"mode": "normal", "column": column})) is right


def test_rivals_count_as_found_in_raster_order_but_not_as_unique() -> None:
    with_rival = line("raster", ["tool_wear"], verdict(("drying_shift", ["tool_wear"])))
    assert in_rival_set(with_rival) and not wrong_unique(with_rival)
    sure = line("raster", ["tool_wear"], verdict(("drying_shift", [])))
    assert not in_rival_set(sure) and wrong_unique(sure)
    assert unique_and_right(verdict(("tool_wear", [])), sure)
    assert not unique_and_right(verdict(("tool_wear", ["drying_shift"])), sure)
    assert not unique_and_right(None, sure)


def test_geometric_and_material_causes_are_counted_separately() -> None:
    lines = [
        line("one cause", ["latency"], verdict(("latency", [])), 0),
        line("one cause", ["latency"], verdict(), 1),
        line("one cause", ["tool_wear"], verdict(("tool_wear", [])), 2),
    ]
    geometric, material = row_of(lines, "geometric"), row_of(lines, "material")
    assert (geometric.hits, geometric.of, geometric.bar) == (1, 2, Bar("at least", 0.95))
    assert (material.hits, material.of, material.bar) == (1, 1, Bar("at least", 0.90))


def test_false_names_exclude_raster_order() -> None:
    lines = [
        line("one cause", ["latency"], verdict(("latency", []), LAG), 0),
        line("none", [], verdict(LAG), 1),
        line("raster", ["tool_wear"], verdict(LAG), 2, second=verdict()),
    ]
    row = row_of(lines, "false names")
    assert (row.hits, row.of) == (2, 3)
    assert row.pixelwise == 1.0 and row.constant == 0.5


def test_world_without_verdict_counts_and_redrawn_world_does_not() -> None:
    lines = [
        line("one cause", ["latency"], None),
        {"series": "one cause", "index": 1, "redrawn": "too weak", "code": "c"},
    ]
    row = row_of(lines, "geometric")
    assert (row.hits, row.of) == (0, 1)


def test_missing_verdict_counts_as_a_miss_in_every_row() -> None:
    lost = [line(series, causes, None) for series, causes in (("none", []), ("raster", ["tool_wear"]))]
    for what in ("any name at all", "wrong unique"):
        assert (row_of(lost, what).hits, row_of(lost, what).of) == (1, 1)
    changed = [line("deleted", ["tool_wear"], None), line("doubled", ["tool_wear"], None)]
    assert row_of(changed, "no neighbour").hits == 0 == row_of(changed, "doubled").hits


def test_gap_closed_counts_exactly_named_worlds_with_strong_effects() -> None:
    lines = [line("one cause", ["latency"], verdict(("latency", []), closed=c), k) for k, c in enumerate((0.6, 0.9, 1))]
    lines.append(line("one cause", ["latency"], verdict(closed=0.0), 3))  # nothing named
    weak = line("one cause", ["latency"], verdict(("latency", []), closed=0.0), 4)
    weak["truth"]["wanted_q"] = [0.1]
    median, tenth = row_of([*lines, weak], "(median)"), row_of([*lines, weak], "10th")
    assert (median.hits, median.of) == (1, 3) and "0.90" in median.note
    assert (tenth.hits, tenth.of) == (2, 3)


def test_interventions_are_counted_where_the_second_verdict_changes() -> None:
    named = verdict(("tool_wear", []))
    stronger = verdict(("tool_wear", []))
    stronger["mse"]["base"] = 5e-4  # with the same gain
    lines = [
        line("shuffled", ["tool_wear"], named, 0, second=verdict()),
        line("shuffled", ["tool_wear"], named, 1, second=named),
        line("shuffled", ["tool_wear"], verdict(), 2, second=verdict()),  # not counted: nothing named at first
        line("doubled", ["tool_wear"], named, 0, second=stronger),
        line("doubled", ["tool_wear"], stronger, 1, second=named),
        line("deleted", ["tool_wear"], named, 0, second=verdict(LAG)),
        line("deleted", ["tool_wear"], named, 1, second=verdict()),
    ]
    for what, hits, of in (("shuffled", 1, 2), ("doubled", 1, 2), ("no neighbour", 1, 2), ("left unexplained", 0, 2)):
        row = row_of(lines, what)
        assert (row.hits, row.of) == (hits, of)
    assert error_removed(stronger, lines[0]) == pytest.approx(2e-4)
    assert error_removed(verdict(), lines[0]) == error_removed(None, lines[0]) == 0.0
    stronger["mse"]["floor"] = None
    assert error_removed(stronger, lines[0]) == pytest.approx(2.5e-4)


def test_page_lists_rows_and_missed_worlds() -> None:
    lines = [line("none", [], verdict(), k) for k in range(60)]
    lines += [line("one cause", ["latency"], verdict(LAG), k) for k in range(12)]
    text = page(STROKES, lines, "abcdef")
    assert "**This is a share of the benchmark**" in text
    assert "| none: any name at all | 0/60 | 0 % |" in text and "abcdef" in text
    assert "**falls short**" in text and text.count("| one cause | ") >= 12
    assert "bristle_lag" in text.split("## Missed")[1]
    mixed = [*lines, line("none", [], verdict(), 60) | {"code": "d"}]
    assert "2 versions of the code" in page(STROKES, mixed, "abcdef") and "versions" not in text


def test_pushes_count_any_structure_by_covariate_and_their_own_geometric_causes() -> None:
    outside = {"effect": "speed_footprint", "mode": "width", "column": "speed_m_s"}
    lines = [
        line("one cause", ["far_field"], verdict(("far_field", []))),
        line("one cause", ["far_field"], verdict(("volume_loss", [])), 1),
        line("one cause", ["tool_backlash"], verdict(("tool_backlash", []), ("far_field", [])), 2),
        line("none", [], verdict()),
        line("none", [], verdict(("far_field", [])), 1),
        line("outside", [], verdict(left=("width", "speed_m_s")), outside=outside),
        line("outside", [], verdict(left=("depth", "speed_m_s")), 1, outside=outside),
    ]
    for each in lines:
        del each["rivals"]
    counted = {row.what: row for row in rows(PUSHES, lines)}
    for what, hits, of in (
        ("one material cause, q .1 to .4: exact set", 1, 2),
        ("one geometric cause, q .1 to .4: exact set", 0, 1),
        ("none: any name at all", 1, 2),
        ("over all: false names among names", 3, 5),
        ("outside the vocabulary: right covariate", 2, 2),
        ("outside the vocabulary: right covariate and mode", 1, 2),
    ):
        assert (counted[what].hits, counted[what].of, counted[what].pixelwise) == (hits, of, None)
    assert counted["one material cause, q .1 to .4: exact set"].constant == 1.0  # both hide the same cause
    assert covariate_found(lines[-1])
    assert "far_field" in page(PUSHES, lines, "abc")


@pytest.mark.parametrize("of", [1, 10, 150])
def test_interval_of_no_and_all_hits_has_a_closed_form(of: int) -> None:
    edge = 0.025 ** (1 / of)  # p with p^n = 2.5 %
    assert interval(of, of) == pytest.approx((edge, 1.0))
    assert interval(0, of) == pytest.approx((0.0, 1 - edge))


def test_interval_holds_the_share_and_narrows_with_more_worlds() -> None:
    (low, high), (lower, higher) = interval(80, 100), interval(8, 10)
    assert lower < low < 0.8 < high < higher
    assert interval(0, 0) == (0.0, 1.0)


def test_bar_missed_by_chance_is_not_rejected() -> None:
    assert not falls_short(94, 100, Bar("at least", 0.95))
    assert falls_short(88, 100, Bar("at least", 0.95))
    assert not falls_short(5, 150, Bar("at most", 0.03))
    assert falls_short(12, 150, Bar("at most", 0.03))


def test_binomial_test_keeps_its_level() -> None:
    """The p value of all or no hits is bar^n, which gives the n from which a bar is rejected."""
    n = 58  # 0.95^58 = 5.1 %, 0.95^59 = 4.8 %
    assert not falls_short(n, n, Bar("at most", 0.95)) and falls_short(n + 1, n + 1, Bar("at most", 0.95))
    assert not falls_short(0, n, Bar("at least", 0.05)) and falls_short(0, n + 1, Bar("at least", 0.05))


def test_no_worlds_fall_short_of_no_bar() -> None:
    assert not falls_short(0, 0, Bar("at least", 0.95))


def test_missed_bar_is_undecided_until_the_test_rejects() -> None:
    shares = [standing(hits, 100, Bar("at least", 0.95)) for hits in (96, 95, 94, 80)]
    assert shares == ["meets", "meets", "undecided", "falls short"]
    assert [standing(hits, 100, Bar("at most", 0.03)) for hits in (3, 4, 12)] == ["meets", "undecided", "falls short"]
