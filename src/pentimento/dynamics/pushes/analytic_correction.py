"""What a network of pushes cannot know, added to what it says.

``param2deform`` sees the surface, length and depth in the constant pose (thesis 7.3.4): where on the table a push is,
which way it goes, when, and after what, is hidden from it. Established causes that go with these are added as

    after = network(S, a) + analytic(S, a; all causes) - analytic(S, a; the others),

both analytic models fitted to the same pushes, so that what a network learns of such causes on average cancels out.
Only what lowers the error on pushes that neither has seen is worth keeping (docs/diagnosis.md §4).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.analytic import AnalyticPush
from pentimento.dynamics.pushes.analytic_file import model_as_json, model_from_json
from pentimento.dynamics.pushes.analytic_scene import PushScene, local_places, push_scene, surface_at_start
from pentimento.planning.pushes.rollout import (
    Array,
    FloatArray,
    Pull,
    PushModel,
)

HIDDEN = ("adhesion_lift", "height_offset", "springback", "stiffness_drift", "tool_backlash", "work_hardening")
"""Causes that go with what a network of the constant pose is not told."""
FILE = "correction.json"
_STEPS = np.array([2e-4, 2e-4, 2e-3, 2e-4, 1e-4])
"""Of the action's numbers, for its gradient: m, m, rad, m, m."""


@dataclass(frozen=True)
class Correction:
    """See above."""

    everything: AnalyticPush
    """With all established causes."""
    seen: AnalyticPush
    """Without those that are hidden from a network."""
    half_width_m: float
    covariates: dict[str, float]
    """Usual values of what the causes depend on, for pushes that are only planned."""

    def of(self, scene: PushScene) -> NDArray[np.float32]:
        """What is added to the height after pushes, float32[B, H, W] metres."""
        return self.everything.change(scene) - self.seen.change(scene)

    def planned(self, height_m: Array, window_m: FloatArray, actions: FloatArray) -> NDArray[np.float32]:
        """The same for K actions [K, 5] upon one height [H, W], under usual conditions on material not yet worked."""
        rows, (height, width) = len(actions), height_m.shape
        scale = width / float(window_m[2] - window_m[0])
        windows = np.tile(np.asarray(window_m, dtype=np.float64), (rows, 1))
        along, across = local_places(windows, (height, width), np.asarray(actions, dtype=np.float64), scale)
        heights = np.broadcast_to(height_m, (rows, height, width))
        level = surface_at_start(heights, along, across)
        columns = {name: np.full(rows, value) for name, value in self.covariates.items()}
        before, pushes = (heights - level[:, None, None]).astype(np.float32), np.asarray(actions, dtype=np.float64)
        worked = np.zeros_like(before)
        return self.of(push_scene(before, along, across, worked, pushes, False, columns, 1 / scale, self.half_width_m))


class CorrectedClay:
    """A push model with a correction; see ``planning.pushes.model.PushModel``.

    Gradients by the action are those of both; by the height below those of the model alone, of which a correction of
    tenths of a millimetre changes little.
    """

    def __init__(self, model: PushModel, correction: Correction) -> None:
        self._model, self._correction = model, correction

    @property
    def window_m(self) -> FloatArray:
        """[4], canvas frame: what the heights cover."""
        return self._model.window_m

    @property
    def end_effector(self) -> str:
        """The model's."""
        return self._model.end_effector

    def after(self, height_m: Array, actions: FloatArray) -> Array:
        """See ``planning.pushes.model.PushModel``."""
        if not len(actions):
            return self._model.after(height_m, actions)
        return self._model.after(height_m, actions) + self._correction.planned(height_m, self.window_m, actions)

    def step(self, height_m: Array, action: FloatArray) -> tuple[Array, Pull]:
        """See ``planning.pushes.model.PushModel``."""
        after, pull = self._model.step(height_m, action)
        around = np.concatenate([action[None], action + np.diag(_STEPS), action - np.diag(_STEPS)])
        said = self._correction.planned(height_m, self.window_m, around)
        slopes = (said[1:6] - said[6:]) / (2 * _STEPS).astype(np.float32)[:, None, None]

        def corrected(cotangent: Array) -> tuple[Array, FloatArray]:
            to_height, to_action = pull(cotangent)
            return to_height, to_action + np.einsum("phw,hw->p", slopes, cotangent)

        return after + said[0], corrected


def corrected(model: PushModel, folder: Path) -> PushModel:
    """The model with the correction that stands in its folder, or as it is where none does.

    Raises:
        ContractError: the file is no correction.
    """
    path = Path(folder) / FILE
    return CorrectedClay(model, read_correction(path)) if path.exists() else model


def correction_as_json(correction: Correction) -> dict[str, Any]:
    """What ``correction.json`` holds."""
    return {
        "everything": model_as_json(correction.everything, correction.half_width_m),
        "seen": model_as_json(correction.seen, correction.half_width_m),
        "covariates": correction.covariates,
    }


def read_correction(path: Path) -> Correction:
    """Read ``correction.json``.

    Raises:
        ContractError: missing, or something else.
    """
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        (everything, width), (seen, _) = (model_from_json(stored[name]) for name in ("everything", "seen"))
        columns = {str(name): float(value) for name, value in stored["covariates"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ContractError(
            f"{path} is not the correction of a push model ({error}); diagnose_pushes writes one."
        ) from error
    return Correction(everything, seen, width, columns)


def split_hidden(
    extended: AnalyticPush, refit: Callable[[AnalyticPush], AnalyticPush]
) -> tuple[AnalyticPush, AnalyticPush] | None:
    """The extended model and the one without hidden causes, each refitted; None where no cause is hidden."""
    hidden = [mechanism.cause for mechanism in extended.mechanisms if mechanism.cause in HIDDEN]
    if not hidden:
        return None
    return refit(extended), refit(extended.without(*hidden))
