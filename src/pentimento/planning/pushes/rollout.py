"""The interface to push models, and sequences of actions through an ensemble of them, with gradients.

A push model is in PyTorch (workshop) or an exported graph (robot). Heights are above the table, metres, float32 [H, W]
over ``window_m`` (canvas frame, row 0 is the top), without holes. An action is x_m, y_m, theta_rad, length_m (pinch:
closing), depth_m, float64 [5], as in the ``pushes`` contract.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.memory import FRESH, PushMemory

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

Pull = Callable[[Array], tuple[Array, FloatArray]]
"""The pull-back of ``PushModel.step``: from ∂loss/∂height after [H, W] to ∂loss/∂height before [H, W] and ∂loss/∂action
[5]. It may be called once."""


class PushModel(Protocol):
    """A model of one end-effector in one material. An ensemble is a sequence of them."""

    @property
    def window_m(self) -> FloatArray:
        """[4] x_min, y_min, x_max, y_max of the height maps, canvas frame."""

    @property
    def end_effector(self) -> str:
        """Name of the end-effector that the model was fitted to."""

    def after(self, height_m: Array, actions: FloatArray, memory: PushMemory = FRESH) -> Array:
        """Heights [K, H, W] after each of K alternative actions [K, 5] on one height map [H, W] with this memory. K may
        be 0."""

    def step(self, height_m: Array, action: FloatArray, memory: PushMemory = FRESH) -> tuple[Array, Pull]:
        """The height [H, W] after an action [5] on a height map [H, W] with this memory, and the pull-back, which
        takes the memory as given."""


_MM = 1e3


class EnsembleRollout:
    """Predicted clay of each member of an ensemble after a sequence of actions, and the value of that prediction.

    The value is the objective of the members' mean, plus ``disagreement_weight`` times their variance in mm² with the
    weight of the 3D error (thesis 7.6.2 asks for such a treatment of uncertainty). With a weight of 1, its 3D
    part is the expected 3D error, since E‖S' − S‖² = ‖S' − ES‖² + Var S. With 0, or one member, it is eq. (7.7).

    Actions act on clay with one ``memory``; ``following`` gives the rollout for clay on which they were executed.
    """

    def __init__(
        self,
        members: Sequence[PushModel],
        objective: ClayObjective,
        disagreement_weight: float,
        *,
        memory: PushMemory = FRESH,
    ) -> None:
        """Take members of one end-effector and one window.

        Raises:
            ValueError: there is no member, or members differ in end-effector or window.
        """
        if len(members) == 0:
            raise ValueError("There is no push model to plan with; give at least one.")
        for member in members[1:]:
            if member.end_effector != members[0].end_effector or not np.allclose(member.window_m, members[0].window_m):
                raise ValueError(
                    "The members of an ensemble differ in end-effector or window; train them on the same table."
                )
        self.members = tuple(members)
        self.objective = objective
        self.disagreement_weight = disagreement_weight
        self.memory = memory

    def remembering(self, memory: PushMemory) -> EnsembleRollout:
        """The same rollout on clay with another memory."""
        return EnsembleRollout(self.members, self.objective, self.disagreement_weight, memory=memory)

    def following(self, actions: FloatArray) -> EnsembleRollout:
        """The same rollout on clay on which these actions [N, 5] were executed as well."""
        return self.remembering(_remembered(self.memory, actions))

    def start(self, height_m: Array) -> Array:
        """Each member's clay [M, H, W] before any action."""
        return np.repeat(height_m[None], len(self.members), axis=0)

    def values_after(self, states_m: Array, actions: FloatArray) -> FloatArray:
        """The value [K] after each of K alternative actions [K, 5] on the members' clay [M, H, W]."""
        after = np.stack(
            [m.after(state, actions, self.memory) for m, state in zip(self.members, states_m, strict=True)]
        )
        values = self.objective.values_from(states_m.mean(axis=0), after.mean(axis=0))
        if len(self.members) > 1 and self.disagreement_weight > 0:
            values = values + self._variance_cost * np.var(after, axis=0).mean(axis=(-2, -1), dtype=np.float64)
        return values

    def value(self, states_m: Array) -> float:
        """The value of the members' clay [M, H, W]."""
        disagreement = float(np.var(states_m, axis=0).mean(dtype=np.float64))
        return float(self.objective.values(states_m.mean(axis=0))) + self._variance_cost * disagreement

    def act(self, states_m: Array, action: FloatArray) -> Array:
        """The members' clay [M, H, W] after an action [5]."""
        pairs = zip(self.members, states_m, strict=True)
        return np.stack([member.after(state, action[None], self.memory)[0] for member, state in pairs])

    def roll_out(self, height_m: Array, actions: FloatArray) -> Array:
        """The members' clay [M, H, W] after a sequence of actions [N, 5]."""
        states = self.start(height_m)
        foresight = self
        for action in actions:
            states, foresight = foresight.act(states, action), foresight.following(action[None])
        return states

    def value_and_gradient(self, height_m: Array, actions: FloatArray) -> tuple[float, FloatArray]:
        """The value after a sequence of actions [N, 5], and its gradient [N, 5]."""
        ends, backs = zip(*(_through(member, height_m, actions, self.memory) for member in self.members), strict=True)
        states = np.stack(ends)
        mean = states.mean(axis=0)
        of_mean = self.objective(mean)[1] / len(states)
        gradient = np.zeros_like(actions)
        for state, back in zip(states, backs, strict=True):
            of_spread = (2 * self._variance_cost / states.size) * (state - mean)
            gradient += back((of_mean + of_spread).astype(np.float32))
        return self.value(states), gradient

    @property
    def _variance_cost(self) -> float:
        """Cost of a variance of 1 m²."""
        return self.disagreement_weight * self.objective.weights.error_3d * _MM**2


def _remembered(memory: PushMemory, actions: FloatArray) -> PushMemory:
    for action in actions:
        memory = memory.after(action)
    return memory


def _through(
    member: PushModel, height_m: Array, actions: FloatArray, memory: PushMemory
) -> tuple[Array, Callable[[Array], FloatArray]]:
    """One member's clay after the actions, and the pull-back from a cotangent [H, W] to the actions' [N, 5]."""
    pulls = []
    for action in actions:
        height_m, pull = member.step(height_m, action, memory)
        pulls.append(pull)
        memory = memory.after(action)

    def back(cotangent: Array) -> FloatArray:
        gradients = []
        for pull in reversed(pulls):
            cotangent, of_action = pull(cotangent)
            gradients.append(of_action)
        return np.stack(gradients[::-1]) if gradients else np.zeros((0, 5))

    return height_m, back
