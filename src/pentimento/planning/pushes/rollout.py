"""The interface to push models, and sequences of actions through an ensemble of them, with gradients.

A push model is in PyTorch (workshop) or an exported graph (robot). Heights are above the table, metres, float32 [H, W]
over ``window_m`` (canvas frame, row 0 is the top), without holes. An action is x_m, y_m, theta_rad, length_m (pinch:
closing), depth_m, float64 [5], as in the ``pushes`` contract.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.ranges import at_least
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.memory import FRESH, PushMemory

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

Pull = Callable[[Array], tuple[Array, FloatArray]]
"""The pull-back of ``PushModel.step``: from ∂loss/∂height after [H, W] to ∂loss/∂height before [H, W] and ∂loss/∂action
[5]. It may be called once."""


class PushModel(Protocol):
    """A model of one end-effector in one material. An ensemble is a sequence of them."""

    def __hash__(self) -> int:
        """By identity: what a model predicts is cached (``screening``), so it must not change."""
        return object.__hash__(self)

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


@dataclass(frozen=True)
class Unexplained:
    """What a push model leaves of pushes that it has not seen, as shares of a push's effect: the energy of the residual
    over that of the change. Fitted by ``dynamics.pushes.uncertainty``."""

    height: float
    """Of heights: ‖residual‖² over ‖change‖²."""
    slope: float
    """Of slopes: ‖∇ residual‖² over ‖∇ change‖²."""

    def __post_init__(self) -> None:
        at_least(self, 0, "height", "slope")


class EnsembleRollout:
    """Predicted clay of each member of an ensemble after a sequence of actions, and the value of that prediction.

    Let Z be the objective (thesis eq. 7.7), S the members' clay and ES their mean. The value is

        Z(ES) + w (E Z(S) − Z(ES)) + w Σ w_3D u ‖c‖² + w_viz v ‖∇c‖²,

    with the disagreement weight w; c is the change by each action, and (u, v) are the shares of it that are
    ``unexplained``. The first bracket is the members' variance in height and slope, with the weights of both errors.
    With w = 1 the value is the expected objective if residuals of pushes are independent (thesis 7.6.2 asks for such a
    treatment of uncertainty). With w = 0, or one member of which nothing is unexplained, it is eq. (7.7).

    Actions act on clay with one ``memory``; ``following`` gives the rollout for clay on which they were executed.
    """

    def __init__(
        self,
        members: Sequence[PushModel],
        objective: ClayObjective,
        disagreement_weight: float,
        *,
        memory: PushMemory = FRESH,
        unexplained: Unexplained | None = None,
        spent: float = 0.0,
    ) -> None:
        """Take members of one end-effector and one window.

        Args:
            unexplained: None where it is not known, which counts as zero.
            spent: cost of what is unexplained of the planned actions so far.

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
        self.unexplained = unexplained
        self.spent = spent
        self._cost = _cost_of_changes(objective, disagreement_weight, unexplained)

    def remembering(self, memory: PushMemory) -> EnsembleRollout:
        """The same rollout on clay with another memory."""
        return self._with(memory, self.spent)

    def following(self, actions: FloatArray) -> EnsembleRollout:
        """The same rollout on clay on which these actions [N, 5] were executed as well."""
        return self.remembering(_remembered(self.memory, actions))

    def towards(self, objective: ClayObjective) -> EnsembleRollout:
        """The same rollout with another objective."""
        return EnsembleRollout(
            self.members, objective, self.disagreement_weight, memory=self.memory, unexplained=self.unexplained
        )

    def start(self, height_m: Array) -> Array:
        """Each member's clay [M, H, W] before any action."""
        return np.repeat(height_m[None], len(self.members), axis=0)

    def values_after(self, states_m: Array, actions: FloatArray) -> FloatArray:
        """The value [K] after each of K alternative actions [K, 5] on the members' clay [M, H, W]."""
        after = self._after_each(states_m, actions)
        before, mean = states_m.mean(axis=0), after.mean(axis=0)
        values = self.objective.values_from(before, mean)
        if self._weighs_spread:
            each = [self.objective.values_from(*pair) for pair in zip(states_m, after, strict=True)]
            values = values + self.disagreement_weight * (np.mean(each, axis=0) - values)
        if self._cost is not None:
            values = values + self._cost.values_from(np.zeros_like(before), mean - before)
        return values + self.spent

    def means_after(self, states_m: Array, actions: FloatArray) -> Array:
        """Mean of the members' clay [K, H, W] after each of K alternative actions [K, 5] on their clay [M, H, W]."""
        return np.asarray(self._after_each(states_m, actions).mean(axis=0))

    def value(self, states_m: Array) -> float:
        """The value of the members' clay [M, H, W]."""
        of_mean = float(self.objective.values(states_m.mean(axis=0)))
        if self._weighs_spread:
            each = float(np.mean([self.objective.values(state) for state in states_m]))
            of_mean += self.disagreement_weight * (each - of_mean)
        return of_mean + self.spent

    def act(self, states_m: Array, action: FloatArray) -> Array:
        """The members' clay [M, H, W] after an action [5]."""
        return self._after_each(states_m, action[None])[:, 0]

    def step(self, states_m: Array, action: FloatArray) -> tuple[Array, EnsembleRollout]:
        """The members' clay [M, H, W] after an action [5], and the rollout from there."""
        after = self.act(states_m, action)
        spent = 0.0
        if self._cost is not None:
            spent = float(self._cost.values(after.mean(axis=0) - states_m.mean(axis=0)))
        return after, self._with(self.memory.after(action), self.spent + spent)

    def after_all(self, height_m: Array, actions: FloatArray) -> tuple[Array, EnsembleRollout]:
        """The members' clay [M, H, W] after a sequence of actions [N, 5], and the rollout from there."""
        states, foresight = self.start(height_m), self
        for action in actions:
            states, foresight = foresight.step(states, action)
        return states, foresight

    def roll_out(self, height_m: Array, actions: FloatArray) -> Array:
        """The members' clay [M, H, W] after a sequence of actions [N, 5]."""
        return self.after_all(height_m, actions)[0]

    def value_after_all(self, height_m: Array, actions: FloatArray) -> float:
        """The value after a sequence of actions [N, 5]."""
        states, foresight = self.after_all(height_m, actions)
        return foresight.value(states)

    def value_and_gradient(self, height_m: Array, actions: FloatArray) -> tuple[float, FloatArray]:
        """The value after a sequence of actions [N, 5], and its gradient [N, 5]."""
        ways, backs = zip(*(_through(member, height_m, actions, self.memory) for member in self.members), strict=True)
        states = np.stack([way[-1] for way in ways])
        spent, of_changes = self._cost_of(np.mean(ways, axis=0))
        of_mean = self.objective(states.mean(axis=0))[1]
        gradient = np.zeros_like(actions)
        for state, back in zip(states, backs, strict=True):
            of_state = of_mean
            if self._weighs_spread:
                of_state = of_mean + self.disagreement_weight * (self.objective(state)[1] - of_mean)
            gradient += back((of_state / len(states)).astype(np.float32), of_changes / np.float32(len(states)))
        return self.value(states) + spent, gradient

    def _cost_of(self, way_m: Array) -> tuple[float, Array]:
        """The cost of what is unexplained on a way [N + 1, H, W], and its gradient [N, H, W] by each change."""
        changes = np.diff(way_m, axis=0)
        if self._cost is None:
            return 0.0, np.zeros_like(changes)
        costs = [self._cost(change) for change in changes]
        return sum(cost for cost, _ in costs), np.array([of for _, of in costs], np.float32).reshape(changes.shape)

    def _after_each(self, states_m: Array, actions: FloatArray) -> Array:
        """Each member's clay [M, K, H, W] after each of K alternative actions [K, 5]."""
        pairs = zip(self.members, states_m, strict=True)
        return np.stack([member.after(state, actions, self.memory) for member, state in pairs])

    def _with(self, memory: PushMemory, spent: float) -> EnsembleRollout:
        return EnsembleRollout(
            self.members, self.objective, self.disagreement_weight, memory=memory, unexplained=self.unexplained,
            spent=spent,
        )  # fmt: skip

    @property
    def _weighs_spread(self) -> bool:
        return len(self.members) > 1 and self.disagreement_weight > 0


def _cost_of_changes(objective: ClayObjective, weight: float, unexplained: Unexplained | None) -> ClayObjective | None:
    """The expected cost of what is unexplained, as an objective of an action's change [H, W]; None without any."""
    if unexplained is None or weight == 0:
        return None
    height = weight * objective.weights.error_3d * unexplained.height
    slope = weight * objective.weights.visual * unexplained.slope
    if height + slope == 0:
        return None
    return objective.of_changes(replace(objective.weights, error_3d=height, visual=slope))


def _remembered(memory: PushMemory, actions: FloatArray) -> PushMemory:
    for action in actions:
        memory = memory.after(action)
    return memory


def _through(
    member: PushModel, height_m: Array, actions: FloatArray, memory: PushMemory
) -> tuple[Array, Callable[[Array, Array], FloatArray]]:
    """One member's clay [N + 1, H, W] before the first and after each action, and the pull-back to the actions' [N, 5]
    from a cotangent [H, W] of the last and [N, H, W] of the changes."""
    pulls, way = [], [height_m]
    for action in actions:
        height_m, pull = member.step(height_m, action, memory)
        pulls.append(pull)
        way.append(height_m)
        memory = memory.after(action)

    def back(cotangent: Array, of_changes: Array) -> FloatArray:
        gradients = []
        for pull, of_change in zip(reversed(pulls), reversed(of_changes), strict=True):
            of_before, of_action = pull(cotangent + of_change)
            cotangent = of_before - of_change
            gradients.append(of_action)
        return np.stack(gradients[::-1]) if gradients else np.zeros((0, 5))

    return np.stack(way), back
