"""Reader of UNIPEN 1.0 (Guyon et al., "UNIPEN project of on-line data exchange and recognizer benchmarks", 1994).

Read are the points between `.PEN_DOWN` and `.PEN_UP`, as `.COORD` names their values: X, Y, and T (milliseconds) and P
(pressure) where there are such. Without T, points are equally spaced by `.POINTS_PER_SECOND`. Segments, labels and
other keywords are passed over.

Y is taken to grow upwards: so draw the tools of the format's authors (uptools3: `Tools/Unipen2eps/unipen2eps.c`,
`Tools/Upread2/output_image.c`). Programs that write screen coordinates make files in which it grows downwards.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.io.pen_strokes import PenFile, PenStroke, with_pressures

FloatArray = NDArray[np.float64]

_INCH_M: Final = 0.0254
_NUMBERS: Final = {
    f".{axis}_POINTS_PER_{unit}": (axis, metres) for axis in "XY" for unit, metres in (("INCH", _INCH_M), ("MM", 1e-3))
}
_RATE: Final = ".POINTS_PER_SECOND"


class _Reader:
    """What the lines before say of the points."""

    def __init__(self, path: Path) -> None:
        self._path, self._line = path, 0
        self._names: list[str] = []
        self._is_down: bool | None = None
        self._rate_hz = np.nan
        self._counted = 0
        self.unit_m: dict[str, float] = {}
        """Metres of a unit of X and Y, where the file says it."""
        self.components: list[list[list[float]]] = []
        """Of each component with the pen down, its points (t_s, x, y, pressure)."""

    def wrong(self, what: str) -> ContractError:
        return ContractError(f"{self._path}, line {self._line}: {what}.")

    def read(self, line: str) -> None:
        self._line += 1
        words = line.split()
        if not words:
            return
        if words[0].startswith(".") and words[0][1:2].isalpha():
            self._keyword(words[0].upper(), words[1:])
        elif self._is_down is not None:
            self._points(words)
        elif self.components and self._is_point(words):
            raise self.wrong("a point follows a keyword that is no .PEN_DOWN; begin its component with .PEN_DOWN")

    def _keyword(self, keyword: str, given: list[str]) -> None:
        self._is_down = {".PEN_DOWN": True, ".PEN_UP": False}.get(keyword)
        if keyword == ".COORD":
            self._names = [name.upper() for name in given]
            if not {"X", "Y"} <= set(self._names):
                raise self.wrong(".COORD names no X and Y; name the values of a point, such as .COORD X Y T")
        elif keyword == ".INCLUDE":
            raise self.wrong("another file is included; import that one, or put its lines here")
        elif keyword in _NUMBERS:
            axis, length_m = _NUMBERS[keyword]
            unit_m = length_m / self._positive(keyword, given)
            if self.components and not np.isclose(self.unit_m.get(axis, unit_m), unit_m, rtol=1e-6):
                raise self.wrong("the unit of length changes; put the recordings into files of their own")
            self.unit_m[axis] = unit_m
        elif keyword == _RATE:
            self._rate_hz = self._positive(keyword, given)
        elif keyword == ".PEN_DOWN":
            self.components.append([])
        if self._is_down is not None and given:  # points may begin on the line of the keyword
            self._points(given)

    def _is_point(self, words: list[str]) -> bool:
        if len(words) != len(self._names):
            return False
        try:
            return bool(np.isfinite(np.array(words, dtype=np.float64)).all())
        except ValueError:
            return False

    def _positive(self, keyword: str, given: list[str]) -> float:
        try:
            value = float(given[0])
        except (IndexError, ValueError):
            value = np.nan
        if not 0 < value < np.inf:
            raise self.wrong(f"{keyword} needs a number above 0")
        return value

    def _points(self, words: list[str]) -> None:
        if not self._names:
            raise self.wrong("points come before .COORD, which names their values; add it, such as .COORD X Y T")
        try:
            values = np.array(words, dtype=np.float64)
        except ValueError:
            raise self.wrong(f"{' '.join(words)[:40]!r} is no point of numbers; correct the line") from None
        if len(values) % len(self._names):
            names = " ".join(self._names)
            raise self.wrong(f"{len(values)} numbers are no points of the values {names}; correct the line")
        for point in values.reshape(-1, len(self._names)):
            of = dict(zip(self._names, map(float, point), strict=True))
            t_s = 1e-3 * of["T"] if "T" in of else self._counted / self._rate_hz
            self._counted += 1
            if self._is_down:
                self.components[-1].append([t_s, of["X"], of["Y"], np.nan, of.get("P", np.nan)])


def read_unipen(path: Path, unit_m: float | None) -> PenFile:
    """Read the components with the pen down.

    Args:
        unit_m: length of a unit of X and Y, where the file does not say it.

    Raises:
        ContractError: the file cannot be read, or a line is wrong, which is named.
        ConfigError: the unit is given twice, or not at all.
    """
    try:
        lines = path.read_text(encoding="latin-1").splitlines()
    except OSError as error:
        raise ContractError(f"{path} cannot be opened ({error.strerror}); check the path.") from error
    reader = _Reader(path)
    for line in lines:
        reader.read(line)
    strokes = [PenStroke(np.array(points), {}) for points in reader.components if points]
    if not strokes:
        raise ContractError(f"{path} has no points after a .PEN_DOWN; see that it is UNIPEN, with its pen data.")
    if reader.unit_m and unit_m is not None:
        raise ConfigError(f"{path} has its own points per inch or mm; leave --units out.")
    x_m, y_m = (reader.unit_m.get(axis, reader.unit_m.get(other, unit_m)) for axis, other in ("XY", "YX"))
    if x_m is None or y_m is None:
        raise ConfigError(
            f"{path} has no .X_POINTS_PER_INCH or .X_POINTS_PER_MM; give --units, such as mm or '0.01 mm'."
        )
    for stroke in strokes:
        stroke.points[:, 1:3] *= [x_m, y_m]
    try:
        return PenFile(strokes, False, with_pressures(strokes, [np.nan] * len(strokes)))
    except ValueError as error:
        raise ContractError(f"{path}: {error}. Correct it, or export the recording again.") from error
