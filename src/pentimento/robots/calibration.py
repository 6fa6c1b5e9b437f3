"""Calibrations on disk. Hardware moves only with calibrations of its rig that are fresh and have small residuals.

One JSON file a kind, `<folder>/<kind>.json`: the values, their time, the digest of their source, and the residual.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.codec import from_plain, to_plain
from pentimento.contracts.errors import CalibrationError
from pentimento.robots.rig import Rig

Kind = Literal["lens", "canvas", "colour", "touch"]

MAX_RESIDUAL: Final[Mapping[Kind, tuple[float, str]]] = {
    "lens": (1.0, "px"),
    "canvas": (2.0, "px"),
    "colour": (4.0, "ΔE2000"),
    "touch": (3e-4, "m"),
}
"""Calibrations with larger residuals are refused."""
_CLOCKS_DIFFER_S = 60.0  # tolerated difference between two computers' clocks
_VERSION = 1


@dataclass(frozen=True)
class Calibration:
    """One calibration of one rig."""

    kind: Kind
    rig: str
    """Digest of the rig file that it was made with."""
    made_unix_s: float
    made_from: str
    """Digest of the photographs or touches that it was computed from."""
    residual: float
    """Residual of the fit in the unit of MAX_RESIDUAL: pixels (RMS), mean ΔE2000, metres (max)."""
    values: dict[str, Any]
    """The result: numbers, and lists of numbers, by name."""


def digest_of(*arrays: NDArray[Any]) -> str:
    """SHA-256 over the arrays' types, shapes and bytes, in their order."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode("ascii"))
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def write_calibration(folder: Path, calibration: Calibration) -> Path:
    """Write it as `<folder>/<kind>.json`, in place of an older one; returns the path."""
    text = json.dumps({"version": _VERSION, **to_plain(calibration)}, indent=2, allow_nan=False)
    path = Path(folder) / f"{calibration.kind}.json"
    atomic_write(path, (text + "\n").encode("utf-8"))
    return path


def read_calibration(folder: Path, kind: Kind) -> Calibration:
    """Read one kind. Raises CalibrationError if it is missing or is no calibration."""
    path = Path(folder) / f"{kind}.json"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise CalibrationError(f"There is no {kind} calibration {path}; calibrate first.") from error
    except ValueError as error:
        raise CalibrationError(f"{path} is not readable as a calibration ({error}); calibrate again.") from error
    if not isinstance(document, dict) or document.pop("version", None) != _VERSION:
        raise CalibrationError(f"{path} is no calibration of version {_VERSION}; calibrate again.")
    try:
        found = from_plain(Calibration, document, str(path), CalibrationError)
    except CalibrationError as error:
        raise CalibrationError(f"{str(error).removesuffix('.')}; calibrate again.") from error
    if found.kind != kind:
        raise CalibrationError(f"{path} is a {found.kind} calibration; calibrate again.")
    return found


def require_fresh(calibration: Calibration, rig: Rig, now_unix_s: float, max_age_s: float) -> None:
    """Return if hardware may move by this calibration; else raise CalibrationError.

    Refused are a calibration of another rig (or of a rig file that was changed since), one older than `max_age_s`
    or dated in the future, and one whose residual is too large or not a number.
    """
    what = f"The {calibration.kind} calibration"
    if calibration.rig != rig.digest or not rig.digest:
        raise CalibrationError(f"{what} is of another rig than {rig.name}, or its file was changed; calibrate again.")
    age_s = now_unix_s - calibration.made_unix_s
    if not age_s >= -_CLOCKS_DIFFER_S:
        raise CalibrationError(f"{what} is dated in the future; set the clock and calibrate again.")
    if not age_s <= max_age_s:
        raise CalibrationError(
            f"{what} is {_age(age_s)} old and at most {_age(max_age_s)} are allowed; calibrate again."
        )
    limit, unit = MAX_RESIDUAL[calibration.kind]
    if not (math.isfinite(calibration.residual) and 0 <= calibration.residual <= limit):
        raise CalibrationError(
            f"{what} leaves {calibration.residual:.3g} {unit} and at most {limit:g} {unit} are allowed; "
            "look at what it was made from and calibrate again."
        )


def _age(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds < 2 * 3600 else f"{seconds / 3600:.1f} h"


def needed_kinds(rig: Rig) -> tuple[Kind, ...]:
    """Kinds that the rig needs before it may move: touch, and with a camera all others."""
    return get_args(Kind) if rig.camera is not None else ("touch",)


def fresh_calibrations(folder: Path, rig: Rig, now_unix_s: float, max_age_s: float) -> dict[Kind, Calibration]:
    """All calibrations that the rig needs. Raises CalibrationError for the first that is missing or not fresh."""
    found = {kind: read_calibration(folder, kind) for kind in needed_kinds(rig)}
    for calibration in found.values():
        require_fresh(calibration, rig, now_unix_s, max_age_s)
    return found


def calibrated(rig: Rig, touch: Calibration) -> Rig:
    """The rig with the surface that a touch calibration found."""
    surface = touch.values.get("surface")
    if touch.kind != "touch" or not isinstance(surface, list) or len(surface) != 3:
        raise CalibrationError("This is no touch calibration; calibrate again.")
    a, b, c = (float(value) for value in surface)
    return rig.with_surface((a, b, c))
