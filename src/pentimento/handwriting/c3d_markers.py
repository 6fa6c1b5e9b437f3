"""Motion capture as C3D: single markers on the canvas and along the pen's axis (thesis 5.3.2; needs the extra c3d).

Three markers on the canvas say where its axes are in each frame; two along the pen, and the measured length beyond the
lower one, where its tip is. Where that is nearer to the canvas than a threshold, the pen draws.
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.handwriting.contact import strokes_in_contact
from pentimento.handwriting.recording import Recording

FloatArray = NDArray[np.float64]

_METRES: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


@dataclass(frozen=True)
class C3D:
    """What is not in the file."""

    canvas: tuple[str, str, str]
    """Labels of three markers: at the canvas's origin, further along its x, and further along its y."""
    raised_m: float
    """Height of these markers' middles over the sheet."""
    pen: tuple[str, str]
    """Labels of the upper and the lower marker on the pen's axis."""
    tip_m: float
    """From the lower marker's middle along the axis to the tip, as measured with a ruler."""
    contact_m: float
    """The pen draws where its tip is lower than this over the sheet."""

    def __post_init__(self) -> None:
        above_zero(self, "contact_m")
        at_least(self, 0, "raised_m", "tip_m")


def read_c3d(path: Path, session: str, hand: str, known: C3D) -> list[Recording]:
    """All strokes of a take. Frames in which a marker is lost are NaN within a stroke.

    Raises:
        ContractError: the file is no C3D, says no unit of length, or lacks one of the markers.
        ConfigError: the extra is not installed.
    """
    try:
        import c3d
    except ImportError as error:
        raise ConfigError(f"To read {path}, install the extra: pip install 'pentimento[c3d]' ({error}).") from error
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "No analog data")  # as it should be of markers alone
            reader = c3d.Reader(io.BytesIO(path.read_bytes()))
            labels = [label.strip() for label in reader.point_labels]
            unit = str(reader.get("POINT:UNITS").string_value).strip().lower()
            rate_hz = float(reader.point_rate)
            frames = [points for _, points, _ in reader.read_frames()]
    except Exception as error:  # the library lets through whatever a damaged file makes go wrong
        raise ContractError(f"{path} cannot be read as C3D: {type(error).__name__}: {error}.") from error
    if unit not in _METRES:
        raise ContractError(f"{path} says {unit or 'nothing'!r} for its unit of length; it must be m, cm or mm.")
    if not frames or not rate_hz > 0:
        raise ContractError(f"{path} has {len(frames)} frames at {rate_hz} Hz; export the take again.")
    points = np.stack(frames).astype(np.float64)  # [frames, markers, x y z residual cameras]
    at_m = np.where(points[..., 3:4] < 0, np.nan, points[..., :3] * _METRES[unit])

    def marker(label: str) -> FloatArray:
        if label not in labels:
            raise ContractError(f"{path} has no marker {label!r}; its markers are {sorted(labels)}.")
        return np.asarray(at_m[:, labels.index(label)])

    upper, lower = (marker(label) for label in known.pen)
    tip = lower + known.tip_m * _unit(lower - upper)
    origin, along_x, along_y = (marker(label) for label in known.canvas)
    x = _unit(along_x - origin)
    up = _unit(np.cross(x, along_y - origin))
    own = np.stack([((tip - origin) * axis).sum(-1) for axis in (x, np.cross(up, x), up)], axis=-1)
    height = own[:, 2] + known.raised_m
    return strokes_in_contact(session, hand, own[:, :2], np.arange(len(own)) / rate_hz, height, known.contact_m)


def _unit(vectors: FloatArray) -> FloatArray:
    """Vectors [K, 3] of length 1; NaN where there is none."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, np.nan))
