"""The rows of the benchmark's table, from the lines of its worlds (docs/blind_tests.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.blind.binomial import Bar
from studies.blind.kinds import Kind

Line = dict[str, Any]
Criterion = Callable[[Line], bool]

HIDDEN = "hidden"
"""`column` of an outside effect that follows no column of the table."""
STRONG_Q = 0.2  # of the effects over which the fraction of the gap closed is counted
_QUANTILES = (
    ("median", "test", 0.92, 0.5),
    ("10th percentile", "test", 0.75, 0.9),
    ("median, out of distribution", "shifted", 0.85, 0.5),
)
"""Quantile, key in the verdict, bar, and the share of worlds at or above such a quantile."""


@dataclass(frozen=True)
class Row:
    """`hits` of `of` worlds (or names) meet the criterion `what`; the same share for two simple baselines, if any."""

    what: str
    hits: int
    of: int
    bar: Bar | None = None
    constant: float | None = None
    """Baseline that gives the most frequent truth as the answer for every world."""
    pixelwise: float | None = None
    """Baseline that selects by the likelihood of pixels (`rivals.py`)."""
    note: str = ""


def hidden(line: Line) -> tuple[str, ...]:
    """The causes that a world hides, sorted."""
    return tuple(sorted(line["truth"]["causes"]))


def named(verdict: dict[str, Any] | None) -> tuple[str, ...]:
    """The established causes of a verdict, sorted."""
    return tuple(sorted(entry["cause"] for entry in verdict["established"])) if verdict else ()


def exact(line: Line) -> bool:
    """Whether the named causes are exactly the hidden ones."""
    return "verdict" in line and named(line["verdict"]) == hidden(line)


def any_name(line: Line) -> bool:
    """Whether any cause is named; a missing verdict counts as one."""
    return "verdict" not in line or bool(named(line["verdict"]))


def outside_found(line: Line) -> bool:
    """Whether the strongest unexplained structure is the hidden one, in mode and covariate.

    For an effect that follows no recorded column: whether nothing is named or unexplained, and a gap is reported.
    """
    verdict, outside = line.get("verdict"), line["truth"]["outside"]
    if verdict is None:
        return False
    left = verdict["unexplained"]
    if outside["column"] == HIDDEN:
        return not left and not verdict["established"] and verdict["floor_reached"] is False
    return bool(left) and (left[0]["mode"], left[0]["covariate"]) == (outside["mode"], outside["column"])


def covariate_found(line: Line) -> bool:
    """Whether any unexplained structure depends on the hidden column."""
    left = line["verdict"]["unexplained"] if "verdict" in line else []
    return any(entry["covariate"] == line["truth"]["outside"]["column"] for entry in left)


def mode_found(line: Line) -> bool:
    """Whether any unexplained structure is the hidden one, in mode and covariate."""
    left = line["verdict"]["unexplained"] if "verdict" in line else []
    outside = line["truth"]["outside"]
    return any((entry["mode"], entry["covariate"]) == (outside["mode"], outside["column"]) for entry in left)


def in_rival_set(line: Line) -> bool:
    """Whether the hidden cause is among the established ones and their rivals."""
    entries = line["verdict"]["established"] if "verdict" in line else []
    return hidden(line)[0] in {name for entry in entries for name in (entry["cause"], *entry["rivals"])}


def wrong_unique(line: Line) -> bool:
    """Whether a cause that is not hidden is named without rivals; a missing verdict counts as one."""
    if "verdict" not in line:
        return True
    entries = line["verdict"]["established"]
    return any(entry["cause"] not in hidden(line) and not entry["rivals"] for entry in entries)


def unique_and_right(verdict: dict[str, Any] | None, line: Line) -> bool:
    """Whether exactly the hidden cause is named, and without rivals."""
    return named(verdict) == hidden(line) and all(not entry["rivals"] for entry in (verdict or {})["established"])


def error_removed(verdict: dict[str, Any] | None, line: Line) -> float:
    """How much error the hidden cause removes on the test split; 0 where it is not named.

    Compared as an absolute error: a gain is a fraction of the gap above the floor, and one near 1 cannot rise.
    """
    if verdict is None:
        return 0.0
    base, floor = verdict["mse"]["base"], verdict["mse"]["floor"]
    gap = base - floor if floor is not None and floor < base else base
    return float(gap * sum(entry["gain"] for entry in verdict["established"] if entry["cause"] in hidden(line)))


def by_series(lines: Iterable[Line]) -> dict[str, list[Line]]:
    """The worlds that could be made, by series; those without a verdict count."""
    found: dict[str, list[Line]] = {}
    for line in lines:
        if "redrawn" not in line:
            found.setdefault(line["series"], []).append(line)
    return found


def rows(kind: Kind, lines: Sequence[Line]) -> list[Row]:
    """All rows that count at least one world."""
    by = by_series(lines)
    one, faint, two, none, outside, raster = (
        by.get(name, []) for name in ("one cause", "one faint cause", "two causes", "none", "outside", "raster")
    )
    geometric = [line for line in one if line["truth"]["causes"][0] in kind.geometric]
    material = [line for line in one if line["truth"]["causes"][0] not in kind.geometric]
    found = [
        _exact("one geometric cause, q .1 to .4: exact set", geometric, 0.95),
        _exact("one material cause, q .1 to .4: exact set", material, 0.90),
        _exact("one cause, q .05: exact set", faint, 0.80),
        _exact("two causes: exact set", two, 0.88),
        Row(
            "none: any name at all", _count(none, any_name), len(none), Bar("at most", 0.03), 1.0,
            _pixelwise(none, lambda line: bool(line["rivals"]["pixels"])),
        ),
        _false_names([*one, *faint, *two, *none, *outside]),
        *_outside(kind, outside),
        *_gap_closed([*one, *two]),
        *_raster(raster),
        *_interventions(by.get("shuffled", []), by.get("doubled", []), by.get("deleted", [])),
        _times(lines, kind.seconds),
    ]  # fmt: skip
    return [row for row in found if row.of]


def _exact(what: str, lines: Sequence[Line], bar: float) -> Row:
    return Row(
        what, _count(lines, exact), len(lines), Bar("at least", bar), _most_frequent([hidden(line) for line in lines]),
        _pixelwise(lines, lambda line: tuple(sorted(line["rivals"]["pixels"])) == hidden(line)),
    )  # fmt: skip


def _false_names(lines: Sequence[Line]) -> Row:
    """Over all worlds of a randomised design."""

    def false(names: Iterable[tuple[str, Line]]) -> tuple[int, int]:
        counted = [name not in hidden(line) for name, line in names]
        return sum(counted), len(counted)

    wrong, of = false((name, line) for line in lines for name in named(line.get("verdict")))
    pixels, all_pixels = false((name, line) for line in lines for name in line.get("rivals", {}).get("pixels", ()))
    causes = Counter(cause for line in lines for cause in hidden(line))
    usual = causes.most_common(1)[0][1] / len(lines) if causes else 0.0
    return Row(
        "over all: false names among names", wrong, of, Bar("at most", 0.03), 1 - usual,
        pixels / all_pixels if all_pixels else None,
    )  # fmt: skip


def _outside(kind: Kind, lines: Sequence[Line]) -> list[Row]:
    """Of strokes the strongest structure must be right in both; of pushes, any structure in its covariate."""
    constant = _most_frequent([str(line["truth"]["outside"]) for line in lines])
    minimum = Bar("at least", 0.92)
    if kind.name == "strokes":
        found = [Row("outside the vocabulary: right mode and covariate", _count(lines, outside_found), len(lines),
                     minimum, constant)]  # fmt: skip
    else:
        found = [
            Row("outside the vocabulary: right covariate", _count(lines, covariate_found), len(lines), minimum),
            Row("outside the vocabulary: right covariate and mode", _count(lines, mode_found), len(lines)),
        ]
    return [
        *found,
        Row(
            "outside the vocabulary: given a known name", _count(lines, any_name), len(lines), Bar("at most", 0.04),
            1.0, _pixelwise(lines, lambda line: bool(line["rivals"]["pixels"])),
        ),
    ]  # fmt: skip


def _gap_closed(lines: Sequence[Line]) -> list[Row]:
    """Of worlds whose causes are named exactly, each with q ≥ .2.

    A median is at least x where half of the worlds reach x, so that a test on a count also tests a quantile.
    """
    strong = [line for line in lines if exact(line) and min(line["truth"]["wanted_q"]) >= STRONG_Q]
    found = []
    for what, key, bar, minimum in _QUANTILES:
        closed = [line["verdict"]["gap_closed"][key] for line in strong]
        known = [float(value) for value in closed if value is not None]
        if not known:
            continue
        note = f"{what} {np.quantile(known, 1 - minimum):.2f}"
        if len(known) < len(closed):
            note += f"; unknown for {len(closed) - len(known)}"
        reached = sum(value >= bar for value in known)
        criterion = f"named, q ≥ .2: gap closed ≥ {bar} ({what})"
        found.append(Row(criterion, reached, len(known), Bar("at least", minimum), 0.0, note=note))
    return found


def _raster(lines: Sequence[Line]) -> list[Row]:
    constant = _most_frequent([hidden(line) for line in lines])
    return [
        Row(
            "raster order: truth in the rival set", _count(lines, in_rival_set), len(lines), Bar("at least", 0.97),
            constant, _pixelwise(lines, lambda line: hidden(line)[0] in line["rivals"]["pixels"]),
        ),
        Row(
            "raster order: a wrong unique name", _count(lines, wrong_unique), len(lines), Bar("at most", 0.03),
            None if constant is None else 1 - constant,
            _pixelwise(lines, lambda line: bool(set(line["rivals"]["pixels"]) - set(hidden(line)))),
        ),
        Row(
            "raster + 16 proposed actions: unique and right",
            _count(lines, lambda line: unique_and_right(line.get("second"), line)), len(lines), Bar("at least", 0.95),
            constant,
        ),
    ]  # fmt: skip


def _interventions(shuffled: Sequence[Line], doubled: Sequence[Line], deleted: Sequence[Line]) -> list[Row]:
    """Shuffling is counted over worlds whose cause the first verdict names."""
    right = [line for line in shuffled if set(hidden(line)) <= set(named(line.get("verdict")))]

    def gone(line: Line) -> bool:
        return "second" in line and not set(hidden(line)) & set(named(line["second"]))

    def risen(line: Line) -> bool:
        return "second" in line and error_removed(line["second"], line) > error_removed(line.get("verdict"), line)

    def unnamed(line: Line) -> bool:
        return "second" in line and not named(line["second"])

    def unexplained(line: Line) -> bool:
        return "second" in line and bool(line["second"]["unexplained"])

    return [
        Row("true covariate shuffled: its name goes", _count(right, gone), len(right)),
        Row("effect doubled: it removes more error", _count(doubled, risen), len(doubled)),
        Row("true candidate deleted: no neighbour is named", _count(deleted, unnamed), len(deleted)),
        Row("true candidate deleted: some structure is left unexplained", _count(deleted, unexplained), len(deleted)),
    ]


def _times(lines: Sequence[Line], limit_s: float) -> Row:
    seconds = [line["seconds"] for line in lines if "seconds" in line]
    note = f"median {np.median(seconds):.1f} s, max {max(seconds):.1f} s" if seconds else ""
    return Row(
        f"verdict within {limit_s:g} s of one processor", sum(s <= limit_s for s in seconds), len(seconds), note=note
    )


def _count(lines: Sequence[Line], criterion: Criterion) -> int:
    return sum(criterion(line) for line in lines)


def _pixelwise(lines: Sequence[Line], criterion: Criterion) -> float | None:
    """Share of all worlds that the baseline on pixels meets; None where it was not run on any."""
    run = [line for line in lines if "rivals" in line]
    return _count(run, criterion) / len(lines) if run else None


def _most_frequent(truths: Sequence[Any]) -> float | None:
    return Counter(truths).most_common(1)[0][1] / len(truths) if truths else None
