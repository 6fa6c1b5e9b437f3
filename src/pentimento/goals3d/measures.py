"""How well a goal was met: errors before and after, and what a reader makes of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.goals3d.reading import LetterReader
from pentimento.planning.objectives import ClayObjective

Array = NDArray[np.float32]


def met(objective: ClayObjective, heights_m: Array, planned_m: Array) -> dict[str, Any]:
    """Errors against the goal over the whole area, of maps [N + 1, H, W] before the first and after each action.

    ``planned_m`` [H, W] is what a plan of all actions at once foretold. To do nothing leaves the error of ``before``.
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


def read_by(reader: LetterReader, height_m: Array, goal_m: Array, border: float) -> dict[str, Any]:
    """What the reader makes of the clay [H, W], and of the goal itself."""
    clay, goal = reader.read(height_m, border), reader.read(goal_m, border)
    return {"clay": clay.letter, "probability": clay.probability, "goal": goal.letter}
