"""What counts as found, missed, and wrong."""

from typing import Any

import pytest

from studies.blind.binomial import Bar
from studies.blind.page import page
from studies.blind.score_card import (
    Row,
    error_removed,
    exact,
    in_rival_set,
    outside_found,
    rows,
    unique_and_right,
    wrong_unique,
)

Line = dict[str, Any]


def verdict(
    *named: tuple[str, list[str]],
    left: tuple[str, str] | None = None,
    reached: bool = True,
    closed: float | None = 0.95,
) -> dict[str, Any]:
    entries = [{"cause": cause, "rivals": rivals, "gain": 0.5} for cause, rivals in named]
    return {
        "established": entries, "suspected": [], "floor_reached": reached, "mse": {"base": 3e-4, "floor": 1e-4},
        "gap_closed": {"test": closed, "ci": None, "shifted": None},
        "unexplained": [{"mode": left[0], "covariate": left[1]}] if left else [],
    }  # fmt: skip


def line(series: str, causes: list[str], said: dict[str, Any] | None, index: int = 0, **more: Any) -> Line:
    outside = more.pop("outside", None)
    truth = {
        "causes": causes, "outside": outside, "tool": "marker", "wanted_q": [0.2] * len(causes),
        "strengths": [{"q": 0.2}] * len(causes),
    }  # fmt: skip
    made = {"series": series, "index": index, "seed": index, "truth": truth, "code": "c", "seconds": 2.0, **more}
    return made | ({"failed": "lost"} if said is None else {"verdict": said, "pixelwise": ["backlash"]})


LAG = ("bristle_lag", list[str]())


def row_of(lines: list[Line], what: str) -> Row:
    (found,) = (row for row in rows(lines) if what in row.what)
    return found


def test_the_exact_set_is_no_less_and_no_more() -> None:
    both = ("latency", list[str]())
    assert exact(line("one cause", ["bristle_lag"], verdict(LAG)))
    assert exact(line("two causes", ["latency", "bristle_lag"], verdict(LAG, both)))
    assert not exact(line("two causes", ["latency", "bristle_lag"], verdict(LAG)))
    assert not exact(line("one cause", ["bristle_lag"], verdict(LAG, both)))
    assert not exact(line("none", [], None))  # no verdict is no exact verdict


@pytest.mark.parametrize(
    ("column", "said", "right"),
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
def test_an_outside_effect_needs_mode_and_covariate(column: str, said: dict[str, Any] | None, right: bool) -> None:
    assert outside_found(line("outside", [], said, outside={"mode": "normal", "column": column})) is right


def test_rivals_count_in_raster_order_and_make_a_name_less_than_unique() -> None:
    unsure = line("raster", ["tool_wear"], verdict(("drying_shift", ["tool_wear"])))
    assert in_rival_set(unsure) and not wrong_unique(unsure)
    sure = line("raster", ["tool_wear"], verdict(("drying_shift", [])))
    assert not in_rival_set(sure) and wrong_unique(sure)
    assert unique_and_right(verdict(("tool_wear", [])), sure)
    assert not unique_and_right(verdict(("tool_wear", ["drying_shift"])), sure)
    assert not unique_and_right(None, sure)


def test_geometric_and_material_causes_have_rows_of_their_own() -> None:
    lines = [
        line("one cause", ["latency"], verdict(("latency", [])), 0),
        line("one cause", ["latency"], verdict(), 1),
        line("one cause", ["tool_wear"], verdict(("tool_wear", [])), 2),
    ]
    geometric, material = row_of(lines, "geometric"), row_of(lines, "material")
    assert (geometric.hits, geometric.of, geometric.bar) == (1, 2, Bar("at least", 0.95))
    assert (material.hits, material.of, material.bar) == (1, 1, Bar("at least", 0.90))


def test_false_names_are_counted_among_names_and_not_in_raster_order() -> None:
    lines = [
        line("one cause", ["latency"], verdict(("latency", []), LAG), 0),
        line("none", [], verdict(LAG), 1),
        line("raster", ["tool_wear"], verdict(LAG), 2, second=verdict()),
    ]
    row = row_of(lines, "false names")
    assert (row.hits, row.of) == (2, 3)
    assert row.pixelwise == 1.0 and row.constant == 0.5


def test_a_world_without_verdict_counts_and_one_drawn_again_does_not() -> None:
    lines = [
        line("one cause", ["latency"], None),
        {"series": "one cause", "index": 1, "redrawn": "too weak", "code": "c"},
    ]
    row = row_of(lines, "geometric")
    assert (row.hits, row.of) == (0, 1)


def test_no_verdict_does_not_pass_for_silence() -> None:
    lost = [line(series, causes, None) for series, causes in (("none", []), ("raster", ["tool_wear"]))]
    for what in ("any name at all", "wrong unique"):
        assert (row_of(lost, what).hits, row_of(lost, what).of) == (1, 1)
    mutated = [line("deleted", ["tool_wear"], None), line("doubled", ["tool_wear"], None)]
    assert row_of(mutated, "deleted").hits == 0 == row_of(mutated, "doubled").hits


def test_gap_closed_is_of_worlds_that_are_named_and_strong() -> None:
    lines = [line("one cause", ["latency"], verdict(("latency", []), closed=c), k) for k, c in enumerate((0.6, 0.9, 1))]
    lines.append(line("one cause", ["latency"], verdict(closed=0.0), 3))  # not named
    weak = line("one cause", ["latency"], verdict(("latency", []), closed=0.0), 4)
    weak["truth"]["wanted_q"] = [0.1]
    median, tenth = row_of([*lines, weak], "(median)"), row_of([*lines, weak], "10th")
    assert (median.hits, median.of) == (1, 3) and "0.90" in median.note
    assert (tenth.hits, tenth.of) == (2, 3)


def test_changes_of_the_truth_must_change_the_verdict() -> None:
    named = verdict(("tool_wear", []))
    stronger = verdict(("tool_wear", []))
    stronger["mse"]["base"] = 5e-4  # and as much of the gap is filled
    lines = [
        line("shuffled", ["tool_wear"], named, 0, second=verdict()),
        line("shuffled", ["tool_wear"], named, 1, second=named),
        line("shuffled", ["tool_wear"], verdict(), 2, second=verdict()),  # no name to lose
        line("doubled", ["tool_wear"], named, 0, second=stronger),
        line("doubled", ["tool_wear"], stronger, 1, second=named),
        line("deleted", ["tool_wear"], named, 0, second=verdict(LAG)),
        line("deleted", ["tool_wear"], named, 1, second=verdict()),
    ]
    for what, hits, of in (("shuffled", 1, 2), ("doubled", 1, 2), ("deleted", 1, 2)):
        row = row_of(lines, what)
        assert (row.hits, row.of) == (hits, of)
    assert error_removed(stronger, lines[0]) == pytest.approx(2e-4)
    assert error_removed(verdict(), lines[0]) == error_removed(None, lines[0]) == 0.0
    stronger["mse"]["floor"] = None
    assert error_removed(stronger, lines[0]) == pytest.approx(2.5e-4)


def test_the_page_lists_rows_and_missed_worlds() -> None:
    lines = [line("none", [], verdict(), k) for k in range(60)]
    lines += [line("one cause", ["latency"], verdict(LAG), k) for k in range(12)]
    text = page(lines, "abcdef")
    assert "**This is a share of the table**" in text
    assert "| none: any name at all | 0/60 | 0 % |" in text and "abcdef" in text
    assert "**falls short**" in text and text.count("| one cause | ") >= 12
    assert "bristle_lag" in text.split("## Missed")[1]
    mixed = [*lines, line("none", [], verdict(), 60) | {"code": "d"}]
    assert "2 versions of the code" in page(mixed, "abcdef") and "versions" not in text
