"""An objective that PyTorch differentiates, as the planner asks for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Array = NDArray[np.float32]


class TorchObjective:
    """A ``planning.objectives.Objective`` from a function of an image [H, W, 3] in linear light to a scalar."""

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        self._function = function

    def __call__(self, image: Array) -> tuple[float, Array]:
        """The value for an image [H, W, 3] in linear light, and its gradient [H, W, 3]."""
        leaf = torch.tensor(image, requires_grad=True)
        with torch.enable_grad():
            value = self._function(leaf)
            (gradient,) = torch.autograd.grad(value, leaf)
        return float(value.detach()), gradient.numpy()
