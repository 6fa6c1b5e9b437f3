"""The random strokes as tensors, and a gradient to pull back."""

import torch
from torch import Tensor

from benchmarks.random_strokes import Case, Kind, arrays_of, as_painting

__all__ = ["Case", "Kind", "as_painting", "image_gradient", "strokes_and_canvas"]


def strokes_and_canvas(case: Case) -> tuple[Tensor, ...]:
    """The inputs of ``as_painting``, float32 and without gradient."""
    return tuple(torch.tensor(array) for array in arrays_of(case))


def image_gradient(case: Case, like: Tensor) -> Tensor:
    """A fixed ∂loss/∂image, so that no loss is timed with the renderer."""
    generator = torch.Generator().manual_seed(case.size_px)
    return torch.randn(like.shape, generator=generator)
