"""A push model by exported graphs in onnxruntime, without PyTorch: ``planning.pushes.model.PushModel``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.planning.pushes.rollout import Array, FloatArray, Pull

Ask = Callable[..., list[NDArray[Any]]]
"""A graph's answers by its name and arguments, as ``bundle.graphs.Graphs`` gives them."""


@dataclass(frozen=True)
class ClayFacts:
    """A push model, beside its graphs ``<name>_after`` and ``<name>_pull``."""

    end_effector: str
    kind: Literal["push", "pinch"]
    window_m: tuple[float, float, float, float]
    """What the height maps cover, canvas frame."""
    shape: tuple[int, int]
    """Of the height maps, [H, W]."""
    longest_m: float
    """Length of travel (pinch: closing) beyond which the model has seen nothing."""
    deepest_m: float
    """Likewise, depth."""


class GraphClay:
    """A push model's graphs as a ``planning.pushes.model.PushModel``."""

    def __init__(self, ask: Ask, name: str, facts: ClayFacts) -> None:
        self._ask, self._name, self._facts = ask, name, facts

    @property
    def window_m(self) -> FloatArray:
        """[4], canvas frame: what the heights cover."""
        return np.array(self._facts.window_m)

    @property
    def end_effector(self) -> str:
        """Name of the end-effector that it was fitted on."""
        return self._facts.end_effector

    def after(self, height_m: Array, actions: FloatArray) -> Array:
        """See ``planning.pushes.model.PushModel``.

        Raises:
            ContractError: heights of another shape, or that are not finite.
        """
        if len(actions) == 0:
            return np.empty((0, *height_m.shape), dtype=np.float32)
        given = np.asarray(actions, dtype=np.float32)
        made: Array = self._ask(f"{self._name}_after", self._checked(height_m), given)[0]
        return made

    def step(self, height_m: Array, action: FloatArray) -> tuple[Array, Pull]:
        """See ``planning.pushes.model.PushModel``.

        Raises:
            ContractError: heights of another shape, or that are not finite.
        """
        height, given = (
            self._checked(height_m).copy(),
            np.array(action, dtype=np.float32),
        )  # both may change before the pull

        def pull(cotangent: Array) -> tuple[Array, FloatArray]:
            back = np.asarray(cotangent, dtype=np.float32)
            to_height, to_action = self._ask(f"{self._name}_pull", height, given, back)
            return to_height, to_action.astype(np.float64)

        return self._ask(f"{self._name}_after", height, given[None])[0][0], pull

    def _checked(self, height_m: Array) -> Array:
        if height_m.shape != self._facts.shape:
            raise ContractError(
                f"The height map is {list(height_m.shape)} and the push model was exported for "
                f"{list(self._facts.shape)} over {list(self._facts.window_m)} m: scan as it says, or export it anew."
            )
        if not np.isfinite(height_m).all():
            raise ContractError("The height map has holes (NaN) or infinite heights; fill them before planning.")
        return np.asarray(height_m, dtype=np.float32)
