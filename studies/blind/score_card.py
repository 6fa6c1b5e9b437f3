"""The rows of the blind table from the lines of its worlds (docs/blind_tests.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.blind.binomial import Bar
from studies.blind.worlds import GEOMETRIC

Line = dict[str, Any]
Judge = Callable[[Line], bool]

HIDDEN = "hidden"
"""The column of an outside effect that follows none of the table."""
STRONG_Q = 0.2
SECONDS = 10.0
_QUANTILES = (
    ("median", "test", 0.92, 0.5),
    ("10th percentile", "test", 0.75, 0.9),
    ("median, shifted context", "shifted", 0.85, 0.5),
)
"""What, where it stands in the verdict, the bar, and the share of worlds that is at or above such a quantile."""


@dataclass(frozen=True)
class Row:
    """`hits` of `of` worlds (or names) do `what`. Rivals: what share of the same the two simple ones have, if any."""

    what: str
    hits: int
    of: int
    bar: Bar | None = None
    constant: float | None = None
    """Names the most frequent truth of its kind in every world."""
    pixelwise: float | None = None
    """Names by the likelihood of pixels (`pixelwise.py`)."""
    note: str = ""


def hidden(line: Line) -> tuple[str, ...]:
    """The causes that a world hides, sorted."""
    return tuple(sorted(line["truth"]["causes"]))


def named(verdict: dict[str, Any] | None) -> tuple[str, ...]:
    """The established causes of a verdict, sorted."""
    return tuple(sorted(entry["cause"] for entry in verdict["established"])) if verdict else ()


def exact(line: Line) -> bool:
    """Whether just what is hidden is named."""
    return "verdict" in line and named(line["verdict"]) == hidden(line)


def outside_found(line: Line) -> bool:
    """Whether the strongest structure that is left unexplained is the hidden one, in mode and covariate.

    Of an effect that follows no recorded column: whether nothing is named or blamed, and a gap is reported.
    """
    said, outside = line.get("verdict"), line["truth"]["outside"]
    if said is None:
        return False
    left = said["unexplained"]
    if outside["column"] == HIDDEN:
        return not left and not said["established"] and said["floor_reached"] is False
    return bool(left) and (left[0]["mode"], left[0]["covariate"]) == (outside["mode"], outside["column"])


def in_rival_set(line: Line) -> bool:
    """Whether the hidden cause is among the established ones and their rivals."""
    entries = line["verdict"]["established"] if "verdict" in line else []
    return hidden(line)[0] in {name for entry in entries for name in (entry["cause"], *entry["rivals"])}


def wrong_unique(line: Line) -> bool:
    """Whether a cause that is not hidden is named without rivals; no verdict is as bad."""
    if "verdict" not in line:
        return True
    entries = line["verdict"]["established"]
    return any(entry["cause"] not in hidden(line) and not entry["rivals"] for entry in entries)


def unique_and_right(verdict: dict[str, Any] | None, line: Line) -> bool:
    """Whether just the hidden cause is named, and without rivals."""
    return named(verdict) == hidden(line) and all(not entry["rivals"] for entry in (verdict or {})["established"])


def error_removed(verdict: dict[str, Any] | None, line: Line) -> float:
    """How much error the hidden cause removes on sealed rows; 0 where it is not named.

    Its gain is a share of the gap above the floor, and one that fills it cannot rise.
    """
    if verdict is None:
        return 0.0
    base, floor = verdict["mse"]["base"], verdict["mse"]["floor"]
    gap = base - floor if floor is not None and floor < base else base
    return float(gap * sum(entry["gain"] for entry in verdict["established"] if entry["cause"] in hidden(line)))


def judged_lines(lines: Iterable[Line]) -> dict[str, list[Line]]:
    """Worlds that could be made, by series; those without a verdict count."""
    found: dict[str, list[Line]] = {}
    for line in lines:
        if "redrawn" not in line:
            found.setdefault(line["series"], []).append(line)
    return found


def rows(lines: Sequence[Line]) -> list[Row]:
    """All rows of which there is a world."""
    by = judged_lines(lines)
    one, faint, two, none, outside, raster = (
        by.get(name, []) for name in ("one cause", "one faint cause", "two causes", "none", "outside", "raster")
    )
    geometric = [line for line in one if line["truth"]["causes"][0] in GEOMETRIC]
    material = [line for line in one if line["truth"]["causes"][0] not in GEOMETRIC]
    made = [
        _exact("one geometric cause, q .1 to .4: exact set", geometric, 0.95),
        _exact("one material cause, q .1 to .4: exact set", material, 0.90),
        _exact("one cause, q .05: exact set", faint, 0.80),
        _exact("two causes: exact set", two, 0.88),
        Row(
            "none: any name at all", _count(none, _any_name), len(none), Bar("at most", 0.03), 1.0,
            _share(none, lambda line: bool(line.get("pixelwise"))),
        ),
        _false_names([*one, *faint, *two, *none, *outside]),
        Row(
            "outside the vocabulary: right mode and covariate", _count(outside, outside_found), len(outside),
            Bar("at least", 0.92), _commonest([str(line["truth"]["outside"]) for line in outside]),
        ),
        Row(
            "outside the vocabulary: given a known name", _count(outside, _any_name), len(outside),
            Bar("at most", 0.04), 1.0, _share(outside, lambda line: bool(line.get("pixelwise"))),
        ),
        *_gap_closed([*one, *two]),
        Row(
            "raster order: truth in the rival set", _count(raster, in_rival_set), len(raster), Bar("at least", 0.97),
            _commonest([hidden(line) for line in raster]),
            _share(raster, lambda line: hidden(line)[0] in line.get("pixelwise", ())),
        ),
        Row(
            "raster order: a wrong unique name", _count(raster, wrong_unique), len(raster), Bar("at most", 0.03),
            _less(_commonest([hidden(line) for line in raster])),
            _share(raster, lambda line: bool(set(line.get("pixelwise", ())) - set(hidden(line)))),
        ),
        Row(
            "raster + 16 proposed actions: unique and right",
            _count(raster, lambda line: unique_and_right(line.get("second"), line)), len(raster), Bar("at least", 0.95),
            _commonest([hidden(line) for line in raster]),
        ),
        *_mutations(by.get("shuffled", []), by.get("doubled", []), by.get("deleted", [])),
        _times(lines),
    ]  # fmt: skip
    return [row for row in made if row.of]


def _exact(what: str, lines: Sequence[Line], bar: float) -> Row:
    return Row(
        what, _count(lines, exact), len(lines), Bar("at least", bar), _commonest([hidden(line) for line in lines]),
        _share(lines, lambda line: tuple(sorted(line.get("pixelwise", ()))) == hidden(line)),
    )  # fmt: skip


def _false_names(lines: Sequence[Line]) -> Row:
    """Over all worlds of a randomised design."""

    def false(names: Iterable[tuple[str, Line]]) -> tuple[int, int]:
        counted = [name not in hidden(line) for name, line in names]
        return sum(counted), len(counted)

    wrong, of = false((name, line) for line in lines for name in named(line.get("verdict")))
    pixels, all_pixels = false((name, line) for line in lines for name in line.get("pixelwise", ()))
    causes = Counter(cause for line in lines for cause in hidden(line))
    usual = causes.most_common(1)[0][1] / len(lines) if causes else 0.0
    return Row(
        "over all: false names among names", wrong, of, Bar("at most", 0.03), 1 - usual,
        pixels / all_pixels if all_pixels else None,
    )  # fmt: skip


def _gap_closed(lines: Sequence[Line]) -> list[Row]:
    """Of worlds whose causes are all named, and no other, each hidden at q ≥ .2.

    A median is at least x where half of all are: a test on a count does for quantiles, too.
    """
    strong = [line for line in lines if exact(line) and min(line["truth"]["wanted_q"]) >= STRONG_Q]
    made = []
    for what, key, bar, minimum in _QUANTILES:
        closed = [line["verdict"]["gap_closed"][key] for line in strong]
        known = [float(value) for value in closed if value is not None]
        if not known:
            continue
        note = f"{what} {np.quantile(known, 1 - minimum):.2f}"
        if len(known) < len(closed):
            note += f"; unknown for {len(closed) - len(known)}"
        reached = sum(value >= bar for value in known)
        said = f"named, q ≥ .2: gap closed ≥ {bar} ({what})"
        made.append(Row(said, reached, len(known), Bar("at least", minimum), 0.0, note=note))
    return made


def _mutations(shuffled: Sequence[Line], doubled: Sequence[Line], deleted: Sequence[Line]) -> list[Row]:
    """A name can only go in worlds whose cause is named as they are."""
    right = [line for line in shuffled if set(hidden(line)) <= set(named(line.get("verdict")))]

    def gone(line: Line) -> bool:
        return "second" in line and not set(hidden(line)) & set(named(line["second"]))

    def risen(line: Line) -> bool:
        return "second" in line and error_removed(line["second"], line) > error_removed(line["verdict"], line)

    def unnamed(line: Line) -> bool:
        return "second" in line and not named(line["second"])

    return [
        Row("true covariate shuffled: its name goes", _count(right, gone), len(right)),
        Row("effect doubled: it removes more error", _count(doubled, risen), len(doubled)),
        Row("true candidate deleted: no neighbour is named", _count(deleted, unnamed), len(deleted)),
    ]


def _times(lines: Sequence[Line]) -> Row:
    seconds = [line["seconds"] for line in lines if "seconds" in line]
    note = f"median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s" if seconds else ""
    return Row(
        f"verdict within {SECONDS:g} s of one processor", sum(s <= SECONDS for s in seconds), len(seconds), note=note
    )


def _any_name(line: Line) -> bool:
    """No verdict is as bad."""
    return "verdict" not in line or bool(named(line["verdict"]))


def _count(lines: Sequence[Line], judge: Judge) -> int:
    return sum(judge(line) for line in lines)


def _share(lines: Sequence[Line], judge: Judge) -> float | None:
    return _count(lines, judge) / len(lines) if lines else None


def _commonest(truths: Sequence[Any]) -> float | None:
    return Counter(truths).most_common(1)[0][1] / len(truths) if truths else None


def _less(share: float | None) -> float | None:
    return None if share is None else 1 - share
