"""Textures of one palette: crops with exactly the same set of grey values."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import skimage
import torch
from numpy.typing import NDArray
from torch import Tensor

T = TypeVar("T")
_SIZE = 512


def soft_blobs(height: int, width: int, seed: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Soft blobs of colour."""
    rng = np.random.default_rng(seed)
    soft = cv2.GaussianBlur(rng.normal(size=(height, width, 3)), (0, 0), 2.0)
    return torch.tensor(0.5 + 0.4 * soft / np.abs(soft).max(), dtype=dtype)


def equal_palette_crops(size: int) -> dict[str, list[Tensor]]:
    """Four crops [size, size, 3] in linear light, without overlap, of each texture."""
    rng = np.random.default_rng(0)
    return {name: [_with_all_greys(part) for part in _corners(image, size)] for name, image in _textures(rng).items()}


def texture_ranks(crops: dict[str, list[T]], distance: Callable[[T, T], float]) -> dict[str, float]:
    """By texture: the share of (crop, one of the same, one of another) where the same is nearer; .5 is chance."""
    ranks = {}
    for name, own in crops.items():
        others = [crop for other, foreign in crops.items() if other != name for crop in foreign]
        right = []
        for index, crop in enumerate(own):
            far = np.array([distance(crop, other) for other in others])
            right += [np.mean(distance(crop, same) < far) for i, same in enumerate(own) if i != index]
        ranks[name] = round(float(np.mean(right)), 3)
    return ranks


def _textures(rng: np.random.Generator) -> dict[str, NDArray[np.float64]]:
    """Photographed ones from scikit-image's wheel, painted ones, and noise with the spectrum of the first."""
    folder = Path(skimage.__file__).parent / "data"
    photographed = {
        name: cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_GRAYSCALE).astype(np.float64)
        for name in ("brick", "grass", "gravel")
    }
    painted = {kind: _painted(kind, rng) for kind in ("strokes", "dots")}
    spectrum = np.abs(np.fft.fft2(photographed["brick"] - photographed["brick"].mean()))
    noise = np.fft.ifft2(spectrum * np.exp(1j * np.angle(np.fft.fft2(rng.normal(size=spectrum.shape))))).real
    return photographed | painted | {"brick's spectrum": noise}


def _painted(kind: str, rng: np.random.Generator) -> NDArray[np.float64]:
    image = np.zeros((_SIZE, _SIZE))
    for _ in range(_SIZE * _SIZE // 150):
        start, grey = rng.integers(0, _SIZE, 2), float(rng.random())
        if kind == "dots":
            cv2.circle(image, tuple(map(int, start)), 4, grey, -1)
        else:
            end = start + rng.normal(0, 14, 2).astype(int)
            cv2.line(image, tuple(map(int, start)), tuple(map(int, end)), grey, 5)
    return image + rng.normal(0, 0.01, image.shape)


def _corners(image: NDArray[np.float64], size: int) -> list[NDArray[np.float64]]:
    return [image[y:, x:][:size, :size] for y in (0, _SIZE - size) for x in (0, _SIZE - size)]


def _with_all_greys(image: NDArray[np.float64]) -> Tensor:
    """The image with its greys replaced by their ranks: every image of this size then holds the same values."""
    ranks = np.argsort(np.argsort(image.ravel(), kind="stable"), kind="stable").reshape(image.shape)
    srgb = (ranks + 0.5) / ranks.size
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return torch.tensor(np.repeat(linear[..., None], 3, axis=-1), dtype=torch.float32)
