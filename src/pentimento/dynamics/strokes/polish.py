"""The last step of fitting a handful of numbers: a search without gradients, from where descent ended.

A crisp mark's coverage, (1 - D/R)^c with c near 0, is nearly a step: what its gradient says of the edge lies in a few
pixels, and descent drifts. The L1 itself is no harder to compare. Softness c stays what descent made it: L1 asks for
marks as crisp as can be, which a planner that follows gradients cannot move, and which cost squared error.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor
from torch.nn.utils import parameters_to_vector, vector_to_parameters

_HELD = "softness_raw"
_STEP, _STEP_OF_VALUE = 0.1, 0.1
"""The first simplex, in the parameters' own units and as a share of each."""
_SAME_LOSS, _SAME_VALUE = 1e-4, 5e-3
"""A simplex whose corners differ by less, of the loss and in the parameters' units, has converged."""
_EVALUATIONS = 100
"""At most, for each parameter."""


def polish(model: torch.nn.Module, loss: Callable[[], Tensor]) -> None:
    """Lower the loss of the model as it is over its parameters but softness, in place, by Nelder-Mead (1965).

    The loss never rises. Parameters should count in units in which 0.1 is a small change.
    """
    parameters = [parameter for name, parameter in model.named_parameters() if not name.endswith(_HELD)]

    def loss_of(values: NDArray[np.float64]) -> float:
        vector_to_parameters(torch.from_numpy(values).float(), parameters)
        return float(loss())

    with torch.no_grad():
        start = parameters_to_vector(parameters).double().numpy().copy()
        corners = start + np.diag(_STEP + _STEP_OF_VALUE * np.abs(start))
        options = {
            "initial_simplex": np.vstack([start, corners]), "adaptive": True, "maxfev": _EVALUATIONS * len(start),
            "fatol": _SAME_LOSS * loss_of(start), "xatol": _SAME_VALUE,
        }  # fmt: skip
        found = minimize(loss_of, start, method="Nelder-Mead", options=options)
        vector_to_parameters(torch.from_numpy(found.x).float(), parameters)
