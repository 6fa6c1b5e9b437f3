"""Scans from files: depth pictures or height maps, as the program of any depth camera saves them.

``FolderScanner`` waits for the file that another program saves; ``RecordedScanner`` replays a folder. Files are
``.npy`` (float, metres, NaN = hole; a depth of 0 is a hole, too) and ``.png`` (16 bits, 0 = hole).
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import from_table
from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.height_maps import decode_height_m
from pentimento.contracts.observations import Scan
from pentimento.robots.rig import Rig
from pentimento.robots.scanner import (
    DepthCamera,
    Pose,
    ScannerError,
    depth_points,
    height_points,
    scan_of_points,
)

FloatArray = NDArray[np.float64]

SUFFIXES: Final = (".npy", ".png")
_POLL_S: Final = 0.1  # between two looks into the folder; a file that is as long at both is complete
_FARTHEST_M: Final = 20.0  # of a depth or height


@dataclass(frozen=True)
class ScanFiles:
    """What the files of a folder hold: the table [scanner] of a rig file for the driver `folder`."""

    driver: str
    folder: str
    wait_s: float
    """Maximum time from the robot's request to a complete file."""
    holds: Literal["depth", "heights"]
    unit_m: float | None = None
    """Of one step of a PNG; needed for such files."""
    focal_px: tuple[float, float] | None = None
    centre_px: tuple[float, float] | None = None
    camera_to_canvas: Pose | None = None
    window_m: tuple[float, float, float, float] | None = None
    """x_min, y_min, x_max, y_max of the canvas frame that heights cover; by default the slab."""

    @property
    def camera(self) -> DepthCamera | None:
        """None where the files hold heights. Raises ConfigError: an entry is missing."""
        if self.holds == "heights":
            return None
        if self.focal_px is None or self.centre_px is None or self.camera_to_canvas is None:
            raise ConfigError("[scanner]: depth pictures need focal_px, centre_px and [scanner.camera_to_canvas].")
        if not min(self.focal_px) > 0:
            raise ConfigError(f"[scanner]: focal_px is {list(self.focal_px)}; both are above zero.")
        return DepthCamera(self.focal_px, self.centre_px, self.camera_to_canvas)

    def read(self, path: Path, area_m: tuple[float, float], shape: tuple[int, int]) -> Scan:
        """The scan in a file, over a slab of this width and height, as [H, W] pixels.

        Raises:
            ScannerError: it cannot be read, holds no depths or heights, or shows less than half of the slab.
        """
        values = self._values(path)
        try:
            if self.camera is None:
                points = height_points(values, (0.0, 0.0, *area_m) if self.window_m is None else self.window_m)
            else:
                if not (
                    0 <= self.camera.centre_px[0] < values.shape[1] and 0 <= self.camera.centre_px[1] < len(values)
                ):
                    raise ScannerError(
                        f"It has {values.shape[1]} x {len(values)} pixels and the centre {list(self.camera.centre_px)} "
                        "of [scanner] lies outside; give the intrinsics of this resolution."
                    )
                points = depth_points(values, self.camera)
            return scan_of_points(points, area_m, shape, f"folder {Path(self.folder).name}")
        except PentimentoError as error:
            raise ScannerError(f"{path} cannot be used: {error}") from error

    def _values(self, path: Path) -> FloatArray:
        """Depths or heights [H, W] in metres, NaN = hole."""
        try:
            if path.suffix.lower() == ".png":
                if self.unit_m is None:
                    raise ConfigError('[scanner] does not say the unit of a PNG; add unit = "0.1 mm".')
                return decode_height_m(path.read_bytes(), self.unit_m)
            values = np.load(path, allow_pickle=False)
        except (OSError, ValueError, EOFError, PentimentoError) as error:
            raise ScannerError(f"{path} cannot be read as a scan: {error}") from error
        if not isinstance(values, np.ndarray) or values.ndim != 2 or values.dtype.kind != "f" or values.size == 0:
            found = f"{values.dtype}{list(values.shape)}" if isinstance(values, np.ndarray) else "an archive"
            raise ScannerError(f"{path} holds {found}; a scan is float [H, W] in metres, NaN where nothing was seen.")
        values = values.astype(np.float64)
        if self.holds == "depth":
            values[values == 0] = np.nan
        known = values[~np.isnan(values)]
        if not known.size:
            raise ScannerError(f"{path} holds nothing but holes; see that the scanner is not covered, and scan again.")
        if np.abs(known).max() > _FARTHEST_M or (self.holds == "depth" and known.min() < 0):
            worst = known[np.abs(known).argmax()] if np.abs(known).max() > _FARTHEST_M else known.min()
            raise ScannerError(
                f"{path} holds a {self.holds.removesuffix('s')} of {worst:g} m; depths are from 0 to {_FARTHEST_M:g} m "
                "and heights as near. Save metres, not millimetres."
            )
        return values


class FolderScanner:
    """A Scanner (see scanner.py): each scan is a file that appears in the folder after it was asked for."""

    def __init__(self, files: ScanFiles, area_m: tuple[float, float], shape: tuple[int, int]) -> None:
        """Raises ConfigError: no such folder, or an entry that depth pictures need is missing."""
        self._files, self._area_m, self._shape = files, area_m, shape
        _checked(files)

    def scan(self) -> Scan:
        old, deadline_s = set(_sizes(self._files.folder)), time.monotonic() + self._files.wait_s
        before: dict[Path, int] = {}
        while True:
            now = {path: size for path, size in _sizes(self._files.folder).items() if path not in old}
            if complete := [path for path, size in now.items() if size > 0 and before.get(path) == size]:
                return self._files.read(complete[-1], self._area_m, self._shape)
            before = now
            if time.monotonic() > deadline_s:
                raise ScannerError(
                    f"No new scan came into {self._files.folder} within {self._files.wait_s:g} s; start the program "
                    f"that saves the camera's pictures there ({', '.join(SUFFIXES)}), or raise wait of [scanner]."
                )
            time.sleep(_POLL_S)

    def close(self) -> None:
        """Nothing is open."""


class RecordedScanner:
    """A Scanner (see scanner.py) that replays the files of a folder in the order of their names.

    What it shows is not there any more: no arm may be moved by it.
    """

    def __init__(self, files: ScanFiles, area_m: tuple[float, float], shape: tuple[int, int]) -> None:
        """Raises ConfigError: no such folder, or an entry that depth pictures need is missing."""
        self._files, self._area_m, self._shape = files, area_m, shape
        _checked(files)
        self._left = list(_sizes(files.folder))
        self._count = len(self._left)

    def scan(self) -> Scan:
        """The next. ScannerError: it cannot be used, or all were given."""
        if not self._left:
            raise ScannerError(f"{self._files.folder} holds {self._count} scans, and all of them were given.")
        return self._files.read(self._left.pop(0), self._area_m, self._shape)

    def close(self) -> None:
        """Nothing is open."""


def connect(rig: Rig, shape: tuple[int, int]) -> FolderScanner:
    """The entry point `folder`. Raises ConfigError: a bad table [scanner], or no such folder."""
    return FolderScanner(
        from_table(ScanFiles, dict(rig.scanner), f"[scanner] of rig {rig.name}"), rig.canvas_size_m, shape
    )


def _checked(files: ScanFiles) -> None:
    if not Path(files.folder).is_dir():
        raise ConfigError(
            f"[scanner] names the folder {files.folder}, which is not there; make it, or correct the name."
        )
    if not files.wait_s > 0:
        raise ConfigError(f"[scanner]: wait is {files.wait_s:g} s; it is above zero.")
    if files.unit_m is not None and not files.unit_m > 0:
        raise ConfigError(f"[scanner]: unit is {files.unit_m:g} m; it is above zero.")
    _ = files.camera  # raises where an entry is missing


def _sizes(folder: str) -> dict[Path, int]:
    """The scans' files in the order of their names, with their sizes in bytes."""
    with os.scandir(folder) as entries:
        found = {Path(entry.path): entry.stat().st_size for entry in entries if entry.name.lower().endswith(SUFFIXES)}
    return dict(sorted(found.items()))
