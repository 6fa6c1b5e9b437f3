"""How well a sculpture meets its goal: errors before and after."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.objectives import ClayObjective

Array = NDArray[np.float32]


def goal_errors(objective: ClayObjective, heights_m: Array, planned_m: Array) -> dict[str, Any]:
    """Errors against the goal over the whole area, for maps [N + 1, H, W] before the first and after each action.

    ``planned_m`` [H, W] is the prediction of a plan of all actions at once. Doing nothing leaves the error of
    ``before``.
    """
    errors: dict[str, Any] = {}
    for name, error in (("error_3d_mm2", objective.error_3d_mm2), ("visual_error", objective.visual_error)):
        values = error(heights_m)
        errors[name] = {
            "before": float(values[0]),
            "after": float(values[-1]),
            "planned": float(error(planned_m)),
            "minimum": float(values.min()),
            "removed": 1 - float(values[-1] / values[0]) if values[0] > 0 else 0.0,
        }
    return errors
