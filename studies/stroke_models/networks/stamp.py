"""A trivial stroke model: the mark that the training strokes leave on average, stretched to a stroke's length."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from pentimento.dynamics.strokes.samples import StrokeSamples
from studies.stroke_models.networks.coverage import measured_coverage
from studies.stroke_models.networks.frame import Crop, crop_around, cut, local_paths, place

_QUANTILES = tuple(k / 10 for k in range(2, 9))
_SHORTEST_M = 2e-3


class Stamp:
    """One image of coverage [h, w] in the stroke's frame."""

    def __init__(self, image: Tensor, crop: Crop, length_m: float) -> None:
        """``length_m``: of the stroke that it is the image of, from end to end."""
        self.image, self.crop, self.length_m = image, crop, length_m

    def __call__(self, samples: StrokeSamples) -> Tensor:
        """Coverage of the samples' windows, [B, H, W]."""
        stretch = _chord_m(samples.path) / self.length_m
        return place(self.image.expand(len(stretch), -1, -1), self.crop, samples, stretch)


def fit_stamp(samples: StrokeSamples, margin_m: float, pixels_per_m: float, error: Callable[[Stamp], float]) -> Stamp:
    """The stamp with the smallest ``error`` among pixelwise quantiles of the training strokes' coverage."""
    length_m = float(_chord_m(samples.path).median())
    crop = crop_around(samples.path, margin_m, pixels_per_m, 2)
    stacked = cut(measured_coverage(samples), crop, samples, _chord_m(samples.path) / length_m)
    stamps = [Stamp(stacked.quantile(q, dim=0), crop, length_m) for q in _QUANTILES]
    return min(stamps, key=error)


def _chord_m(path: Tensor) -> Tensor:
    chord = local_paths(path)[:, -1, 0]
    return chord.clamp(min=_SHORTEST_M)
