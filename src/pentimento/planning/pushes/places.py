"""The place model: the height that a pellet adds, a round footprint with four fitted numbers.

A pellet of volume V at (x_0, y_0) adds, at the distance r from there,

    f(r) = A exp(−(r / w)^p),   w = w_ref (V / V_ref)^a,   A = κ V / (2 π w² Γ(2/p) / p),

so that ∫ f = κ V: the volume is conserved up to the compaction 1 − κ. The surface below the pellet does not matter to
the model. ``unexplained`` is the share of the footprints' energy ∫ f² that it did not predict of the pellets that it
was fitted to: errors of place and volume, ovals, neighbours that the pad met.

A place is x_m, y_m, volume_m3, float64 [3], canvas frame.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import from_plain
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import Window, pixel_to_canvas, pixels_per_m

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

FILE = "places.json"
X, Y, VOLUME = range(3)
"""Columns of a place [3]."""
GROWTH = (0.1, 0.45)
"""Bounds of a: 1/3 keeps the shape; below 1/2 a larger pellet is also higher."""
FLATNESS = (2.0, 8.0)
"""Bounds of p: 2 is a Gaussian, 8 nearly a disc. Below 2 the footprint would have a cusp."""


@dataclass(frozen=True)
class PlaceModel:
    """A fitted footprint."""

    feeder: str
    """Name of the feeder."""
    kept: float
    """κ: the share of a pellet's volume that the surface gains."""
    width_m: float
    """w_ref: radius at which a pellet of the reference volume has fallen to 1/e."""
    growth: float
    """a."""
    flatness: float
    """p."""
    reference_m3: float
    """V_ref."""
    volume_m3: tuple[float, float]
    """(min, max) of the pellets that it was fitted to."""
    unexplained: float
    """Share of the energy of the observed changes that it leaves."""
    places: int
    """Number of pellets that it was fitted to."""

    def __post_init__(self) -> None:
        positive = (self.kept, self.width_m, self.reference_m3, self.volume_m3[0])
        within = GROWTH[0] <= self.growth <= GROWTH[1] and FLATNESS[0] <= self.flatness <= FLATNESS[1]
        if not (min(positive) > 0 and within and self.volume_m3[0] <= self.volume_m3[1] and self.unexplained >= 0):
            raise ValueError(
                f"kept, width_m, reference_m3 and volume_m3 must be above 0, growth within {list(GROWTH)}, flatness "
                f"within {list(FLATNESS)} and unexplained 0 or more."
            )

    def radius_m(self, volume_m3: float) -> float:
        """w of a pellet."""
        return float(self.width_m * (volume_m3 / self.reference_m3) ** self.growth)

    def peak_m(self, volume_m3: float) -> float:
        """A of a pellet: the height of its middle."""
        area = 2 * math.pi * self.radius_m(volume_m3) ** 2 * math.gamma(2 / self.flatness) / self.flatness
        return float(self.kept * volume_m3 / area)

    def volume_of_peak(self, peak_m: FloatArray) -> FloatArray:
        """Volumes [...] of pellets with peaks [...]; the inverse of ``peak_m``."""
        relative = np.asarray(peak_m, dtype=np.float64) / self.peak_m(self.reference_m3)
        return np.asarray(self.reference_m3 * relative ** (1 / (1 - 2 * self.growth)))

    def energy_m4(self, volume_m3: float) -> float:
        """∫ f² of a pellet; it grows as the power 2 − 2 a of its volume."""
        falloff = 2 * math.pi * math.gamma(2 / self.flatness) / (self.flatness * 2 ** (2 / self.flatness))
        return float((self.peak_m(volume_m3) * self.radius_m(volume_m3)) ** 2 * falloff)

    def change(self, places: FloatArray, shape: tuple[int, int], window_m: Window) -> FloatArray:
        """Height [K, H, W] that each of K pellets [K, 3] adds, over a window."""
        grid = _grid(shape, window_m)
        return np.array([self._footprint(place, grid)[0] for place in places]).reshape(-1, *shape)

    def step(
        self, place: FloatArray, shape: tuple[int, int], window_m: Window
    ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        """The height [H, W] that a pellet [3] adds, and the pull-back from ∂loss/∂height [H, W] to ∂loss/∂place [3]."""
        grid = _grid(shape, window_m)
        added, ratio, radius_m = self._footprint(place, grid)

        def pull(cotangent: FloatArray) -> FloatArray:
            weighted = cotangent * added
            # ∂f/∂x_0 = f p ρ^(p−2) (x − x_0) / w²; p is 2 or more, so that the middle is no exception.
            inward = weighted * self.flatness * ratio ** (self.flatness - 2) / radius_m**2
            by_volume = weighted * (1 - 2 * self.growth + self.flatness * self.growth * ratio**self.flatness)
            return np.array(
                [
                    float((inward * (grid[..., 0] - place[X])).sum()),
                    float((inward * (grid[..., 1] - place[Y])).sum()),
                    float(by_volume.sum()) / float(place[VOLUME]),
                ]
            )

        return added, pull

    def _footprint(self, place: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """f [H, W], r / w [H, W] and w."""
        volume, radius_m = float(place[VOLUME]), self.radius_m(float(place[VOLUME]))
        ratio = np.hypot(grid[..., 0] - place[X], grid[..., 1] - place[Y]) / radius_m
        return self.peak_m(volume) * np.exp(-(ratio**self.flatness)), ratio, radius_m


def _grid(shape: tuple[int, int], window_m: Window) -> FloatArray:
    """Places [H, W, 2] of the pixels, canvas frame."""
    pixels = np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), axis=-1)
    return pixel_to_canvas(pixels, window_m, pixels_per_m(shape, window_m))


def place_model_bytes(model: PlaceModel) -> bytes:
    """Content of ``places.json``."""
    return (json.dumps(asdict(model), indent=2) + "\n").encode()


def place_model_from(content: bytes, name: str) -> PlaceModel:
    """The place model in the content of a file of this name.

    Raises:
        ContractError: it is not a place model.
    """
    try:
        plain = json.loads(content)
    except ValueError as error:
        raise ContractError(f"{name} is not a place model ({error}); train_push_dynamics writes one.") from error
    return from_plain(PlaceModel, plain, name)


def read_place_model(path: Path) -> PlaceModel:
    """Read ``places.json``.

    Raises:
        ContractError: the file is missing or its content is not a place model.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ContractError(
            f"{path} cannot be read ({error.strerror}); train_push_dynamics writes it of pushes with placed pellets "
            "(params.yaml: collect_pushes.pellets)."
        ) from error
    return place_model_from(content, str(path))
