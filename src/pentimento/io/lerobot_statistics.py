"""What LeRobot keeps of each feature to normalise by: least, greatest, mean, standard deviation, number of frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Statistics(NamedTuple):
    """Of a feature over some frames; arrays of one shape, [D] for numbers and [3, 1, 1] for pictures in 0 to 1."""

    minimum: Array
    maximum: Array
    mean: Array
    variance: Array
    frames: int

    def told(self) -> dict[str, Any]:
        """By LeRobot's names, as lists."""
        values = {"min": self.minimum, "max": self.maximum, "mean": self.mean, "std": np.sqrt(self.variance)}
        return {name: value.tolist() for name, value in values.items()} | {"count": [self.frames]}


def of_numbers(values: Array) -> Statistics:
    """Of numbers [N, D], one row a frame."""
    return Statistics(values.min(0), values.max(0), values.mean(0), values.var(0), len(values))


def of_picture(picture: NDArray[np.uint8], frames: int) -> Statistics:
    """Of a picture [H, W, 3] that so many frames show."""
    one = of_numbers(picture.reshape(-1, 3) / 255.0)
    minimum, maximum, mean, variance = (value.reshape(3, 1, 1) for value in one[:4])
    return Statistics(minimum, maximum, mean, variance, frames)


def pooled(parts: Sequence[Statistics]) -> Statistics:
    """Of the frames of all parts together."""
    frames = [part.frames for part in parts]
    mean = np.average([part.mean for part in parts], axis=0, weights=frames)
    return Statistics(
        np.min([part.minimum for part in parts], axis=0),
        np.max([part.maximum for part in parts], axis=0),
        mean,
        np.average([part.variance + (part.mean - mean) ** 2 for part in parts], axis=0, weights=frames),
        sum(frames),
    )
