"""From recordings to the ``demonstrations`` table: import, repair, standard frame, counts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa

from pentimento.contracts.demonstrations import CONTRACT
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.tables import read_table
from pentimento.handwriting.json_recordings import read_quickdraw, read_tablet
from pentimento.handwriting.motion_capture import C3D, OptiTrack, read_c3d, read_optitrack
from pentimento.handwriting.recording import PRESSURE, Recording, plausible, standardise, to_source
from pentimento.handwriting.repair import Limits, Repaired, repair_all
from pentimento.handwriting.svg_recordings import read_svg

_NAME: Final = re.compile(r"(?![.\s])[^/\\\x00-\x1f\x7f]{1,80}(?<!\s)")
_TAKEN: Final = ("bezier", "blank", "map", "nobody", "strokes", "target")
"""Names of other things among the files and metrics of writers."""


@dataclass(frozen=True)
class Source:
    """One recorded file."""

    path: str
    format: Literal["optitrack", "c3d", "tablet", "quickdraw", "svg", "demonstrations"]
    session: str
    hand: str
    unit_m: float | None
    """Length of the file's unit in metres, where the file has none (quickdraw never has one)."""
    optitrack: OptiTrack | None
    """For that format."""
    c3d: C3D | None = None
    """For that format."""

    def __post_init__(self) -> None:
        if _NAME.fullmatch(self.hand) is None or self.hand in _TAKEN:
            raise ValueError(
                f"hand is {self.hand!r}; it names files: 1 to 80 characters without slashes, no dot at its beginning, "
                f"no space at its ends, and none of {', '.join(_TAKEN)}."
            )
        if self.unit_m is not None and not 0 < self.unit_m <= 1:
            raise ValueError(
                f"unit_m is {self.unit_m}; it is the length of the file's unit in metres, above 0, up to 1."
            )


@dataclass(frozen=True, eq=False)
class Gathered:
    """The table, counts of strokes and faults, and the faulty recordings."""

    table: pa.Table
    counts: dict[str, Any]
    repaired: list[Repaired]
    """The recordings with any fault."""


def read_source(source: Source) -> list[Recording]:
    """All strokes of one file, as recorded.

    Raises:
        ContractError: the file does not follow its format, or ``plausible`` refuses its strokes.
        ConfigError: a setting that the format needs is missing.
    """
    path = Path(source.path)
    match source.format:
        case "optitrack":
            if source.optitrack is None:
                raise ConfigError(f"{path}: the format optitrack needs the entry `optitrack`; give it.")
            return read_optitrack(path, source.session, source.hand, source.optitrack)
        case "c3d":
            if source.c3d is None:
                raise ConfigError(f"{path}: the format c3d needs the entry `c3d`; give it.")
            return read_c3d(path, source.session, source.hand, source.c3d)
        case "tablet":
            return read_tablet(path, source.session, source.hand, source.unit_m)
        case "quickdraw":
            if source.unit_m is None:
                raise ConfigError(f"{path}: the format quickdraw needs unit_m, the length of a pixel; give it.")
            return read_quickdraw(path, source.session, source.hand, source.unit_m)
        case "svg":
            return read_svg(path, source.session, source.hand, source.unit_m)
        case "demonstrations":
            return read_demonstrations(path, source.session, source.hand)


def read_demonstrations(path: Path, session: str, hand: str) -> list[Recording]:
    """All strokes of a table of demonstrations, such as `pentimento import` writes, at their places.

    Raises:
        ContractError: it is no such table, or is not plausible.
    """
    rows = read_table(path, CONTRACT).table.select(["points", "standard_to_source"]).to_pylist()
    placed = [to_source(*(np.array(value, dtype=np.float64) for value in row.values())) for row in rows]
    return plausible(path, [Recording(session, hand, points) for points in placed])


def gather(recordings: Sequence[Recording], limits: Limits, points: int) -> Gathered:
    """Repair all recordings and resample them to ``points`` points each in the standard frame.

    Raises:
        ContractError: no stroke is left.
    """
    repaired = repair_all(recordings, limits)
    strokes, faults = repaired.strokes, repaired.counts
    if not strokes:
        raise ContractError(f"None of the {len(recordings)} recorded strokes can be used: {faults}.")
    number: Counter[str] = Counter()
    rows = []
    for stroke in strokes:
        standard, transform = standardise(stroke.points, points)
        rows.append({
            "session": stroke.session, "hand": stroke.hand, "index": number[stroke.session],
            "points": standard.astype(np.float32).tolist(), "standard_to_source": transform.tolist(),
        })  # fmt: skip
        number[stroke.session] += 1
    counts = {
        "recorded": len(recordings),
        "kept": len(strokes),
        "refused": sum(count for fault, count in faults.items() if fault.startswith("strokes_")),
        "without_pressure": sum(bool(np.isnan(stroke.points[:, PRESSURE]).any()) for stroke in strokes),
        "hands": dict(Counter(stroke.hand for stroke in strokes)),
        "sessions": len(number),
        "faults": faults,
    }
    return Gathered(pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT)), counts, repaired.faulty)
