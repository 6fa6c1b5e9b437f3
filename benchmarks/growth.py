"""How time grows: the exponent of a power law, and the cost that the dense reference would have."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

LARGEST = 3
"""So many of the largest sizes are fitted again by themselves: at small ones fixed costs flatten the growth."""


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """The slope of log time in log size, least squares: 1 where twice the work takes twice the time."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def extrapolated(strokes: Sequence[int], seconds: Sequence[float], wanted: int) -> float:
    """The straight line through the measured times, at ``wanted`` strokes."""
    slope, start = np.polyfit(strokes, seconds, 1)
    return float(start + slope * wanted)


def picked(rows: Iterable[dict[str, Any]], **wanted: object) -> list[dict[str, Any]]:
    """The rows that have these values."""
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def exponents(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of the plain cases on one thread, forward + backward: in strokes at each canvas, in pixels at each count."""
    found = []
    for points in sorted({case["points"] for case in cases}):
        plain = picked(cases, points=points, threads=1, kind="plain")
        for fixed, free, power, name in (("size_px", "strokes", 1, "strokes"), ("strokes", "size_px", 2, "pixels")):
            for value in sorted({case[fixed] for case in plain}):
                rows = sorted(picked(plain, **{fixed: value}), key=lambda row: row[free])
                sizes = [row[free] ** power for row in rows]
                seconds = [row["forward_backward"]["minimum_s"] for row in rows]
                found.append(
                    {
                        "in": name, "points": points, fixed: value,
                        "exponent": exponent(sizes, seconds), "far": exponent(sizes[-LARGEST:], seconds[-LARGEST:]),
                    }
                )  # fmt: skip
    return found
