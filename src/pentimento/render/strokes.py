"""What the renderers draw."""

from __future__ import annotations

from typing import Any, Generic, NamedTuple, TypeVar

T = TypeVar("T")


class PixelStrokes(NamedTuple, Generic[T]):
    """S strokes of N points on each of B canvases, in pixel coordinates: arrays of NumPy or tensors of PyTorch.

    The strokes of a single canvas have no B.
    """

    points: T
    """float[B, S, N, 2], path points (column, row); a path of one point is a disc."""
    radius: T
    """float[B, S, N], half the stroke's width [px]."""
    density: T
    """float[B, S, N], coverage at the centre of the path, 0 to 1."""
    softness: T
    """float[B, S, N], the exponent c of ``render.kernel``: 0 gives a hard disc, 1 a cone."""
    color: T
    """float[B, S, 3], linear light."""
    pickup: T | None = None
    """float[B, S], the share of picked-up wet paint in the paint that a stroke lays down, 0 to 1. None: tools stay
    clean."""

    def at(self, index: Any) -> PixelStrokes[T]:
        """The same with every array indexed: by a number the strokes of one canvas, by None a batch of one canvas."""
        arrays: tuple[Any, ...] = self
        return PixelStrokes(*(None if array is None else array[index] for array in arrays))
