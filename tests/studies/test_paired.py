"""Two methods are compared on worlds that both have."""

from typing import Any

from studies.blind.paired import table


def line(number: int, hidden: tuple[str, ...], named: tuple[str, ...]) -> dict[str, Any]:
    verdict = {"established": [{"cause": name} for name in named], "unexplained": []}
    truth = {"causes": list(hidden), "outside": None}
    series = "one cause" if hidden else "none"
    return {"series": series, "seed": number, "truth": truth, "verdict": verdict}


def test_only_common_worlds_are_compared() -> None:
    """Six worlds that only one method has right: p = 2 / 2^6 (exact McNemar test)."""
    right = [line(number, ("latency",), ("latency",)) for number in range(8)]
    wrong = [line(number, ("latency",), ("backlash",)) for number in range(6)]
    rows = table(right, [*wrong, line(6, ("latency",), ("latency",)), line(99, ("latency",), ())])
    assert "| one cause | 7 | 7 | 1 | 6 | 0 | 0.03 |" in rows
    assert rows.endswith("False names: 0 here, 6 there.")


def test_no_name_is_right_where_nothing_is_hidden() -> None:
    rows = table([line(1, (), ())], [line(1, (), ("latency",))])
    assert "| none | 1 | 1 | 0 | 1 | 0 | 1.00 |" in rows
