"""The sculptor's seam: what pushes will do to the clay, in values and in gradients.

It does not say how that is computed: the workshop's push models are PyTorch's, a robot's are exported graphs. Heights
are above the table, metres, float32 [H, W] over ``window_m`` (canvas frame, row 0 is the top), without holes. An action
is x_m, y_m, theta_rad, length_m (pinch: closing), depth_m, float64 [5], as in the ``pushes`` contract.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

Pull = Callable[[Array], tuple[Array, FloatArray]]
"""From ∂loss/∂height after [H, W] to ∂loss/∂height before [H, W] and ∂loss/∂action [5]: ``step``, backwards. Called at
most once."""


class PushModel(Protocol):
    """A model of one end-effector in one material. An ensemble is a sequence of them."""

    @property
    def window_m(self) -> FloatArray:
        """[4], canvas frame: what the heights cover."""

    @property
    def end_effector(self) -> str:
        """Name of the end-effector that it was fitted on."""

    def after(self, height_m: Array, actions: FloatArray) -> Array:
        """Heights [K, H, W] after each of K alternative actions [K, 5] upon one height [H, W]; K from 0."""

    def step(self, height_m: Array, action: FloatArray) -> tuple[Array, Pull]:
        """The height [H, W] after an action [5] upon a height [H, W], and the way back for gradients."""
