"""Correction of a push network by causes that its inputs hide.

``param2deform`` sees the surface, length and depth in the constant pose (thesis 7.3.4). Place on the table, heading,
time and history are hidden from it. Established causes that depend on these are added as

    after = network(S, a) + analytic(S, a; all causes) - analytic(S, a; visible causes),

with both analytic models fitted to the same pushes, so that what the network learned of such causes on average cancels
out. A correction is kept only if it lowers the error on pushes that neither has seen (docs/diagnosis.md §10).

The same compiled code corrects the network in the workshop and the bundle's graphs on the robot, so that what was
diagnosed is what is deployed. What happened to the clay before comes from a ``planning.pushes.memory.PushMemory``.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import from_plain, to_plain
from pentimento.contracts.errors import ContractError
from pentimento.planning.pushes.analytic.model import AnalyticPush, model_as_json, model_from_json
from pentimento.planning.pushes.analytic.scene import (
    PushScene,
    local_places,
    push_scene,
    surface_at_start,
    swept_m,
)
from pentimento.planning.pushes.memory import FRESH, PushMemory
from pentimento.planning.pushes.rollout import Array, FloatArray, Pull, PushModel

FILE = "correction.json"
_STEPS = np.array([2e-4, 2e-4, 2e-3, 2e-4, 1e-4])
"""Steps of the action's components for its finite-difference gradient: m, m, rad, m, m."""


@dataclass(frozen=True)
class Range:
    """Values of a covariate."""

    low: float
    mean: float
    high: float

    def expected(self, known: float | None) -> float:
        """The value that a planned push is taken to have: as it is known, but within the range; else the mean."""
        return self.mean if known is None or known != known else min(max(known, self.low), self.high)


@dataclass(frozen=True)
class Correction:
    """Difference of two fitted analytic models, added to the prediction of a network."""

    extended: AnalyticPush
    """With all established causes."""
    visible: AnalyticPush
    """Without the causes that are hidden from the network."""
    half_width_m: float
    covariates: dict[str, Range]
    """Of the pushes to which the models were fitted."""

    def of(self, scene: PushScene) -> NDArray[np.float32]:
        """Height added after pushes, float32[B, H, W] metres."""
        return self.extended.change(scene) - self.visible.change(scene)

    def planned(
        self, height_m: Array, window_m: FloatArray, actions: FloatArray, memory: PushMemory = FRESH
    ) -> NDArray[np.float32]:
        """The same for K alternative actions [K, 5] on one height map [H, W] with this memory.

        A covariate beyond its range counts as the range's end, so that a drift is never extrapolated.
        """
        rows, (height, width) = len(actions), height_m.shape
        scale = width / float(window_m[2] - window_m[0])
        windows = np.tile(np.asarray(window_m, dtype=np.float64), (rows, 1))
        along, across = local_places(
            windows, (height, width), action=np.asarray(actions, dtype=np.float64), pixels_per_m=scale
        )
        heights = np.broadcast_to(height_m, (rows, height, width))
        level = surface_at_start(heights, along, across)
        columns = {
            name: np.full(rows, known.expected(memory.covariates.get(name))) for name, known in self.covariates.items()
        }
        before, pushes = (heights - level[:, None, None]).astype(np.float32), np.asarray(actions, dtype=np.float64)
        worked = np.zeros_like(before)
        for action in memory.actions:
            worked += _swept_by(tuple(action.tolist()), tuple(windows[0].tolist()), (height, width), self.half_width_m)
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


@lru_cache(maxsize=256)
def _swept_by(
    action: tuple[float, ...], window_m: tuple[float, ...], shape: tuple[int, int], half_width_m: float
) -> NDArray[np.float32]:
    """Depth [H, W] of one earlier push, as ``PushScene.worked`` sums it."""
    one, window = np.array([action]), np.array([window_m])
    scale = shape[1] / float(window[0, 2] - window[0, 0])
    along, across = local_places(window, shape, action=one, pixels_per_m=scale)
    return swept_m(along, across, length_m=one[:, 3], depth_m=one[:, 4], half_width_m=half_width_m)[0]


class CorrectedClay:
    """A push model with a correction; implements ``planning.pushes.rollout.PushModel``.

    Gradients by the action include the correction. Gradients by the height are those of the model alone: a correction
    of tenths of a millimetre hardly changes them. There are none by the memory.
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

    def after(self, height_m: Array, actions: FloatArray, memory: PushMemory = FRESH) -> Array:
        """See ``planning.pushes.rollout.PushModel``."""
        after = self._model.after(height_m, actions, memory)
        return after + self._correction.planned(height_m, self.window_m, actions, memory) if len(actions) else after

    def step(self, height_m: Array, action: FloatArray, memory: PushMemory = FRESH) -> tuple[Array, Pull]:
        """See ``planning.pushes.rollout.PushModel``."""
        after, pull = self._model.step(height_m, action, memory)
        around = np.concatenate([action[None], action + np.diag(_STEPS), action - np.diag(_STEPS)])
        corrections = self._correction.planned(height_m, self.window_m, around, memory)
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
        "covariates": {name: to_plain(known) for name, known in correction.covariates.items()},
    }


def read_correction(path: Path) -> Correction:
    """Read ``correction.json``.

    Raises:
        ContractError: the file is missing or its content is not a correction.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ContractError(f"{path} cannot be read ({error.strerror}); diagnose_pushes writes it.") from error
    return correction_from(content, str(path))


def correction_from(content: bytes, name: str) -> Correction:
    """The correction in the content of a file of this name.

    Raises:
        ContractError: it is not a correction.
    """
    try:
        stored = json.loads(content)
        (extended, width), (visible, _) = (model_from_json(stored[part]) for part in ("everything", "seen"))
        columns = from_plain(dict[str, Range], stored["covariates"], name)
    except (ValueError, KeyError, TypeError, AttributeError, ContractError) as error:
        raise ContractError(
            f"{name} is not the correction of a push model ({error}); diagnose_pushes writes one."
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
