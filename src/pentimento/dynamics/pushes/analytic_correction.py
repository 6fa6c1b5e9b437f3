"""Correction of a push network by causes that its inputs hide.

``param2deform`` sees the surface, length and depth in the constant pose (thesis 7.3.4). Place on the table, heading,
time and history are hidden from it. Established causes that depend on these are added as

    after = network(S, a) + analytic(S, a; all causes) - analytic(S, a; visible causes),

with both analytic models fitted to the same pushes, so that what the network learned of such causes on average cancels
out. A correction is kept only if it lowers the error on pushes that neither has seen (docs/diagnosis.md §10).
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
from pentimento.dynamics.pushes.analytic import AnalyticPush, model_as_json, model_from_json
from pentimento.dynamics.pushes.analytic_scene import PushScene, local_places, push_scene, surface_at_start
from pentimento.planning.pushes.rollout import Array, FloatArray, Pull, PushModel

FILE = "correction.json"
_STEPS = np.array([2e-4, 2e-4, 2e-3, 2e-4, 1e-4])
"""Steps of the action's components for its finite-difference gradient: m, m, rad, m, m."""


@dataclass(frozen=True)
class Correction:
    """Difference of two fitted analytic models, added to the prediction of a network."""

    extended: AnalyticPush
    """With all established causes."""
    visible: AnalyticPush
    """Without the causes that are hidden from the network."""
    half_width_m: float
    covariates: dict[str, float]
    """Mean values of the covariates, used for pushes that are only planned."""

    def of(self, scene: PushScene) -> NDArray[np.float32]:
        """Height added after pushes, float32[B, H, W] metres."""
        return self.extended.change(scene) - self.visible.change(scene)

    def planned(self, height_m: Array, window_m: FloatArray, actions: FloatArray) -> NDArray[np.float32]:
        """The same for K actions [K, 5] on one height map [H, W], at mean covariates and on material without a
        history."""
        rows, (height, width) = len(actions), height_m.shape
        scale = width / float(window_m[2] - window_m[0])
        windows = np.tile(np.asarray(window_m, dtype=np.float64), (rows, 1))
        along, across = local_places(
            windows, (height, width), action=np.asarray(actions, dtype=np.float64), pixels_per_m=scale
        )
        heights = np.broadcast_to(height_m, (rows, height, width))
        level = surface_at_start(heights, along, across)
        columns = {name: np.full(rows, value) for name, value in self.covariates.items()}
        before, pushes = (heights - level[:, None, None]).astype(np.float32), np.asarray(actions, dtype=np.float64)
        worked = np.zeros_like(before)
        return self.of(
            push_scene(
                before,
                along,
                across,
                worked=worked,
                action=pushes,
                history_known=False,
                covariates=columns,
                pixel_m=1 / scale,
                half_width_m=self.half_width_m,
            )
        )


class CorrectedClay:
    """A push model with a correction; implements ``planning.pushes.rollout.PushModel``.

    Gradients by the action include the correction. Gradients by the height are those of the model alone: a correction
    of tenths of a millimetre hardly changes them.
    """

    def __init__(self, model: PushModel, correction: Correction) -> None:
        self._model, self._correction = model, correction

    @property
    def window_m(self) -> FloatArray:
        """[4], canvas frame: the area of the height maps."""
        return self._model.window_m

    @property
    def end_effector(self) -> str:
        """End-effector of the model."""
        return self._model.end_effector

    def after(self, height_m: Array, actions: FloatArray) -> Array:
        """See ``planning.pushes.rollout.PushModel``."""
        if not len(actions):
            return self._model.after(height_m, actions)
        return self._model.after(height_m, actions) + self._correction.planned(height_m, self.window_m, actions)

    def step(self, height_m: Array, action: FloatArray) -> tuple[Array, Pull]:
        """See ``planning.pushes.rollout.PushModel``."""
        after, pull = self._model.step(height_m, action)
        around = np.concatenate([action[None], action + np.diag(_STEPS), action - np.diag(_STEPS)])
        corrections = self._correction.planned(height_m, self.window_m, around)
        slopes = (corrections[1:6] - corrections[6:]) / (2 * _STEPS).astype(np.float32)[:, None, None]

        def corrected(cotangent: Array) -> tuple[Array, FloatArray]:
            to_height, to_action = pull(cotangent)
            return to_height, to_action + np.einsum("phw,hw->p", slopes, cotangent)

        return after + corrections[0], corrected


def corrected(model: PushModel, folder: Path) -> PushModel:
    """The model with the correction in its folder, or unchanged if there is none.

    Raises:
        ContractError: the file is not a correction.
    """
    path = Path(folder) / FILE
    return CorrectedClay(model, read_correction(path)) if path.exists() else model


def correction_as_json(correction: Correction) -> dict[str, Any]:
    """Content of ``correction.json``."""
    return {
        "everything": model_as_json(correction.extended, correction.half_width_m),
        "seen": model_as_json(correction.visible, correction.half_width_m),
        "covariates": correction.covariates,
    }


def read_correction(path: Path) -> Correction:
    """Read ``correction.json``.

    Raises:
        ContractError: the file is missing or its content is not a correction.
    """
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        (extended, width), (visible, _) = (model_from_json(stored[name]) for name in ("everything", "seen"))
        columns = {str(name): float(value) for name, value in stored["covariates"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ContractError(
            f"{path} is not the correction of a push model ({error}); diagnose_pushes writes one."
        ) from error
    return Correction(extended, visible, width, columns)


def split_hidden(
    extended: AnalyticPush, refit: Callable[[AnalyticPush], AnalyticPush]
) -> tuple[AnalyticPush, AnalyticPush] | None:
    """The extended model and the one without hidden causes, each refitted; None where no cause is hidden."""
    hidden = [mechanism.cause for mechanism in extended.mechanisms if mechanism.hidden_from_network]
    if not hidden:
        return None
    return refit(extended), refit(extended.without(*hidden))
