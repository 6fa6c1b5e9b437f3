"""The rows of the blind table of pushes from the lines of its worlds (docs/blind_pushes.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from studies.blind.binomial import Bar
from studies.blind.score_card import Row, error_removed, exact, hidden, judged_lines, named
from studies.blind_pushes.worlds import GEOMETRIC

Line = dict[str, Any]

STRONG_Q = 0.2
SECONDS = 60.0


def rows(lines: Sequence[Line]) -> list[Row]:
    """All rows of which there is a world."""
    by = judged_lines(lines)
    one, two, none, outside = (by.get(name, []) for name in ("one cause", "two causes", "none", "outside"))
    geometric = [line for line in one if hidden(line)[0] in GEOMETRIC]
    material = [line for line in one if hidden(line)[0] not in GEOMETRIC]
    everything = [line for lines_of_one in by.values() for line in lines_of_one]
    names = [(name, line) for line in [*one, *two, *none, *outside] for name in named(line.get("verdict"))]
    made = [
        _exact("one geometric cause, q .1 to .4: exact set", geometric, 0.95),
        _exact("one material cause, q .1 to .4: exact set", material, 0.90),
        _exact("two causes: exact set", two, 0.88),
        Row("none: any name at all", _count(none, any_name), len(none), _most(0.03), constant=1.0),
        Row(
            "over all: false names among names", sum(name not in hidden(line) for name, line in names), len(names),
            _most(0.03), constant=_false_of_constant([*one, *two, *none, *outside]),
        ),
        Row("outside the vocabulary: right covariate", _count(outside, covariate_found), len(outside), _minimum(0.92)),
        Row("outside the vocabulary: right covariate and mode", _count(outside, mode_found), len(outside)),
        Row(
            "outside the vocabulary: given a known name", _count(outside, any_name), len(outside), _most(0.04),
            constant=1.0,
        ),
        *_gap_closed([*one, *two]),
        *_mutations(by.get("shuffled", []), by.get("doubled", []), by.get("deleted", [])),
        _times(everything),
    ]  # fmt: skip
    return [row for row in made if row.of]


def _exact(what: str, lines: Sequence[Line], minimum: float) -> Row:
    """Beside it: always naming what is hidden most often in these worlds."""
    often = Counter(map(hidden, lines)).most_common(1)
    constant = often[0][1] / len(lines) if often else None
    return Row(what, _count(lines, exact), len(lines), _minimum(minimum), constant=constant)


def _false_of_constant(lines: Sequence[Line]) -> float | None:
    """How many names are false where each world gets the cause that is hidden most often."""
    often = Counter(name for line in lines for name in hidden(line)).most_common(1)
    return sum(often[0][0] not in hidden(line) for line in lines) / len(lines) if often else None


def any_name(line: Line) -> bool:
    """No verdict is as bad."""
    return "verdict" not in line or bool(named(line["verdict"]))


def covariate_found(line: Line) -> bool:
    """Whether something depends on the hidden column, by what is left unexplained."""
    left = line["verdict"]["unexplained"] if "verdict" in line else []
    return any(one["covariate"] == line["truth"]["outside"]["column"] for one in left)


def mode_found(line: Line) -> bool:
    """Whether the hidden mode does."""
    left = line["verdict"]["unexplained"] if "verdict" in line else []
    outside = line["truth"]["outside"]
    return any((one["mode"], one["covariate"]) == (outside["mode"], outside["column"]) for one in left)


def _gap_closed(lines: Sequence[Line]) -> list[Row]:
    """Of worlds whose causes are all named, and no other, each hidden at q ≥ .2."""
    strong = [line for line in lines if exact(line) and min(line["truth"]["wanted_q"]) >= STRONG_Q]
    closed = [line["verdict"]["gap_closed"]["test"] for line in strong]
    known = [float(value) for value in closed if value is not None]
    if not known:
        return []
    note = f"median {np.median(known):.2f}, 10th percentile {np.quantile(known, 0.1):.2f}"
    what = "named, q ≥ .2: gap closed ≥ .92 (median)"
    return [Row(what, sum(value >= 0.92 for value in known), len(known), _minimum(0.5), note=note)]


def _mutations(shuffled: Sequence[Line], doubled: Sequence[Line], deleted: Sequence[Line]) -> list[Row]:
    """A name can only go in worlds whose cause is named as they are."""
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
        Row("true candidate deleted: something is left unexplained", _count(deleted, unexplained), len(deleted)),
    ]


def _times(lines: Sequence[Line]) -> Row:
    seconds = [line["seconds"] for line in lines if "seconds" in line]
    note = f"median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s" if seconds else ""
    return Row(
        f"verdict within {SECONDS:g} s of one processor", sum(s <= SECONDS for s in seconds), len(seconds), note=note
    )


def _count(lines: Sequence[Line], judge: Callable[[Line], bool]) -> int:
    return sum(judge(line) for line in lines)


def _minimum(share: float) -> Bar:
    return Bar("at least", share)


def _most(share: float) -> Bar:
    return Bar("at most", share)
