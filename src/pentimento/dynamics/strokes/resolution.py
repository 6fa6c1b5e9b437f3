"""Resolution and margin at which a table's photographs are compared with a model, by the line's width and the windows.

A photograph is coarse enough when a window is quick to render, and fine enough when a line is several pixels wide.
Below about one pixel, a wide pale line and a narrow dark one look the same, and a fit lands in either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import above_zero

Auto = Literal["auto"]
AUTO: Final[Auto] = "auto"

LINE_PX: Final = 3.0
"""Photographs are averaged down only as long as the line stays so many pixels wide."""
_ENOUGH_PX: Final = 200**2
"""Photographs are averaged down where the padded windows have more pixels."""
_POOR_LINE_PX: Final = 1.5
"""Width of a line below which width and darkness are hard to tell apart."""
_NEAR_M: Final = 0.012
"""Margin of wide tools: errors of placement depend on the robot and the camera, not on the line."""
_MAX_WIDTHS: Final = 10.0
"""Margin of thin tools, in line widths."""
_MIN_WIDTHS: Final = 1.5
"""Margin of very wide tools: half a width for the line, and a whole one for its displacement."""


class RowExtent(NamedTuple):
    """What one row shows, at its photographs' own resolution."""

    length_m: float
    """Of the path."""
    ink_m2: float
    """Inked area that touches the path."""
    pixels_per_m: float
    size_m: tuple[float, float]
    """Width and height of the path's bounding box."""
    paper_m: tuple[float, float, float, float]
    """Paper left, right, below and above that box in the window; negative where the path leaves it."""


@dataclass(frozen=True)
class Sampling:
    """How a table's photographs are sampled."""

    pixels_per_m: float
    """Finer photographs are averaged down to about this."""
    margin_m: float
    """Windows are trimmed to this much around the commanded path."""
    line_width_m: float
    """Median width of the inked lines."""

    @property
    def line_px(self) -> float:
        """Width of the line in pixels."""
        return self.line_width_m * self.pixels_per_m

    @property
    def sentence(self) -> str:
        """What was chosen, and a warning where the photographs are too coarse for the line."""
        text = (
            f"The line is {1e3 * self.line_width_m:.2f} mm wide (median). Photographs are compared at "
            f"{self.pixels_per_m / 1e3:.3g} px/mm, {self.line_px:.1f} pixels across the line, with up to "
            f"{1e3 * self.margin_m:.3g} mm of paper around each path."
        )
        if self.line_px >= _POOR_LINE_PX:
            return text
        wanted = LINE_PX / self.line_width_m / 1e3
        return f"{text} That is too coarse to tell width from darkness: use photographs of {wanted:.3g} px/mm or more."


def choose_sampling(rows: Sequence[RowExtent], pixels_per_m: float | Auto, margin_m: float | Auto) -> Sampling:
    """Replace each "auto" by the choice for these rows; it does not depend on their order.

    Raises:
        ContractError: no row has ink, so that the line's width is unknown.
    """
    inked = [row for row in rows if row.ink_m2 > 0 and row.length_m > 0]
    if not inked:
        raise ContractError(
            f"None of the {len(rows)} strokes left ink that can be seen on its path, so that the line's width is "
            "unknown: look at the table's photographs, windows and color_srgb."
        )
    width = float(np.median([_line_width_m(row) for row in inked]))
    margin = _margin_m(rows, width) if isinstance(margin_m, str) else margin_m
    scale = _pixels_per_m(rows, width, margin) if isinstance(pixels_per_m, str) else pixels_per_m
    return Sampling(scale, margin, width)


def check_sampling(config: Any) -> None:
    """Raise ValueError, a sentence, where a number `pixels_per_m` or `margin_m` of a config is not above 0."""
    above_zero(config, *(name for name in ("pixels_per_m", "margin_m") if getattr(config, name) != AUTO))


def _line_width_m(row: RowExtent) -> float:
    """Width of a line with round ends: area = w L + π w² / 4."""
    return 2 * (math.sqrt(row.length_m**2 + math.pi * row.ink_m2) - row.length_m) / math.pi


def _margin_m(rows: Sequence[RowExtent], width_m: float) -> float:
    """By the line's width, but no more than any window has."""
    wanted = min(_MAX_WIDTHS * width_m, max(_MIN_WIDTHS * width_m, _NEAR_M))
    stored = max(max(row.paper_m) for row in rows)
    return min(wanted, stored) if stored > 0 else wanted


def _pixels_per_m(rows: Sequence[RowExtent], width_m: float, margin_m: float) -> float:
    """The finest photographs' resolution over a whole number."""
    finest = max(row.pixels_per_m for row in rows)
    sides = [
        row.pixels_per_m * (size + sum(max(min(margin_m, paper), 0.0) for paper in row.paper_m[at : at + 2]))
        for row in rows
        for at, size in ((0, row.size_m[0]), (2, row.size_m[1]))
    ]
    padded = max(sides[::2]) * max(sides[1::2])
    quick = math.ceil(math.sqrt(padded / _ENOUGH_PX))
    fine = math.floor(width_m * finest / LINE_PX)
    return finest / max(min(quick, fine), 1)
