"""Rows of a strokes table that can be used; bad rows and copies are left out and counted (docs/diagnosis.md §13)."""

from __future__ import annotations

import math
from collections.abc import Sized
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.tables import MAX_BAD_SHARE, reason_list, row_fingerprint, row_list
from pentimento.dynamics.strokes.samples import StrokeSamples, inked_share, load_samples

_MANY_UNMARKED = 0.1
"""Share of rows without a visible mark from which the verdict mentions it."""
_VISIBLE_SHARE = 0.08
"""Way from paper to paint from which a pixel is marked; pale pens mark little more."""
_MIN_MARKED = 0.0004
"""Share of a window's pixels that a visible mark covers."""
_MIN_INSIDE = 0.2
"""Share of a path's points that must lie in its window."""


class UsableRows(NamedTuple):
    """Rows that can be used, and what was left out."""

    table: pa.Table
    bad: dict[int, str]
    """Row of the table as given, and why it makes no sample."""
    copies: tuple[int, ...]
    """Exact copies of earlier rows, which would pass for repeats without noise."""

    unmarked: int
    """Number of used rows without a visible mark of their paint near the path."""

    def sentences(self) -> list[str]:
        """What was left out, as sentences."""
        lines = []
        if self.bad:
            lines.append(
                f"{row_list(list(self.bad))} cannot be used and {_are(self.bad)} left out: {reason_list(self.bad)}."
            )
        if self.copies:
            copies = "is an exact copy of another" if len(self.copies) == 1 else "are exact copies of others"
            lines.append(f"{row_list(list(self.copies))} {copies} and left out; a copy is no repeat of an action.")
        if self.unmarked > _MANY_UNMARKED * self.table.num_rows:
            lines.append(
                f"{self.unmarked} of {self.table.num_rows} rows show no mark of their paint near the path; check "
                "color_srgb, the windows, and whether the tool touched."
            )
        return lines


def usable_rows(table: pa.Table) -> UsableRows:
    """The rows of a table of the strokes contract from which samples can be made, each once.

    Raises:
        ContractError: more than 1 % of the rows (and more than one) are bad; it names them.
    """
    bad: dict[int, str] = {}
    copies: list[int] = []
    unmarked = 0
    seen: set[bytes] = set()
    for number in range(table.num_rows):
        row = table.slice(number, 1)
        try:
            samples = load_samples(row, 8, math.inf, 1.0)
        except PentimentoError as error:
            bad[number] = str(error).partition("strokes table: ")[2] or str(error)
            continue
        if not float(samples.path[0, :, 1:3].diff(dim=0).norm(dim=-1).sum()) > 0:
            bad[number] = "its path does not move"
            continue
        if _inside(row) < _MIN_INSIDE:
            bad[number] = "its path lies outside its window"
            continue
        fingerprint = row_fingerprint(row.to_pylist()[0], "path")
        if fingerprint in seen:
            copies.append(number)
            continue
        seen.add(fingerprint)
        unmarked += not _shows_a_mark(samples)
    if len(bad) > max(1, math.floor(MAX_BAD_SHARE * table.num_rows)) or 0 < len(bad) == table.num_rows:
        raise ContractError(
            f"{len(bad)} of {table.num_rows} rows of the strokes table cannot be used ({row_list(list(bad))}): "
            f"{reason_list(bad)}. Repair the recording; at most 1 % of the rows is left out."
        )
    left_out = {*bad, *copies}
    kept = [number for number in range(table.num_rows) if number not in left_out]
    return UsableRows(table if not left_out else table.take(kept), bad, tuple(copies), unmarked)


def _shows_a_mark(samples: StrokeSamples) -> bool:
    """Whether some part of the window changes towards the paint's colour by more than noise."""
    share = inked_share(samples.before, samples.after, samples.color[:, None, None])
    return float(share.flatten().quantile(1 - _MIN_MARKED)) > _VISIBLE_SHARE


def _inside(row: pa.Table) -> float:
    """Share of the path's points that lie in the window."""
    x_min, y_min, x_max, y_max = row["window_m"][0].as_py()
    x, y = np.array(row["path"][0].as_py())[:, 1:3].T
    return float(((x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max)).mean())


def _are(rows: Sized) -> str:
    return "is" if len(rows) == 1 else "are"
