"""Rollouts of action sequences: values, gradients, and the cost of ensemble variance."""

import numpy as np
import pytest

from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.memory import FRESH, PushMemory
from pentimento.planning.pushes.rollout import EnsembleRollout, Unexplained
from tests.planning.pushes.clay import WINDOW_M, PressedClay, flat

PUSHES = np.array([[0.03, 0.04, 0.4, 0.02, 0.005], [0.06, 0.05, 2.0, 0.015, 0.004]])
GOAL = (flat() + np.random.default_rng(0).normal(0, 5e-4, flat().shape)).astype(np.float32)
OBJECTIVE = ClayObjective(GOAL, WINDOW_M, Weights(1.0, 2.0))


def test_rollout_gradient_agrees_with_finite_differences() -> None:
    foresight = EnsembleRollout([PressedClay(), PressedClay(radius_m=0.012)], OBJECTIVE, disagreement_weight=2.0)
    _, gradient = foresight.value_and_gradient(flat(), PUSHES)
    way = np.random.default_rng(1).normal(0, 1, PUSHES.shape) * [1e-4, 1e-4, 1e-2, 1e-4, 1e-4]
    low, high = (foresight.value(foresight.roll_out(flat(), PUSHES + sign * way)) for sign in (-1, 1))
    assert 0.5 * (high - low) == pytest.approx(float((gradient * way).sum()), rel=0.02)


def test_alternative_actions_have_the_values_of_single_actions() -> None:
    foresight = EnsembleRollout([PressedClay(), PressedClay(strength=0.8)], OBJECTIVE, disagreement_weight=1.0)
    states = foresight.start(flat())
    alone = [foresight.value(foresight.act(states, push)) for push in PUSHES]
    np.testing.assert_allclose(foresight.values_after(states, PUSHES), alone, rtol=1e-5)


@pytest.mark.parametrize("weights", [Weights(1.0, 0.0), Weights(1.0, 2.0), Weights(0.5, 2.0, 0.004)])
def test_a_disagreement_weight_of_one_gives_the_expected_objective(weights: Weights) -> None:
    members = [PressedClay(), PressedClay(strength=0.6)]
    objective = ClayObjective(GOAL, WINDOW_M, weights)
    states = EnsembleRollout(members, objective, disagreement_weight=1.0).roll_out(flat(), PUSHES)
    expected = float(objective.values(states).mean())
    assert EnsembleRollout(members, objective, disagreement_weight=1.0).value(states) == pytest.approx(
        expected, rel=1e-3
    )
    assert EnsembleRollout(members, objective, disagreement_weight=0.0).value(states) < expected


def test_equal_members_have_no_spread() -> None:
    three, one = ([PressedClay()] * count for count in (3, 1))
    values = [
        EnsembleRollout(members, OBJECTIVE, weight).value_after_all(flat(), PUSHES)
        for members, weight in ((three, 9.0), (one, 0.0))
    ]
    assert values[0] == pytest.approx(values[1], rel=1e-5)


@pytest.mark.parametrize("count", [1, 2])
def test_what_is_unexplained_costs_a_share_of_each_change(count: int) -> None:
    members = [PressedClay(), PressedClay(radius_m=0.012)][:count]
    sure = EnsembleRollout(members, OBJECTIVE, 2.0)
    unsure = EnsembleRollout(members, OBJECTIVE, 2.0, unexplained=Unexplained(height=0.1, slope=0.3))
    states, spent = sure.start(flat()), 0.0
    for push in PUSHES:
        after = sure.act(states, push)
        change = (after - states).mean(axis=0)
        zero = ClayObjective(np.zeros_like(GOAL), WINDOW_M, Weights(1.0, 1.0))
        spent += 2.0 * (0.1 * float(zero.error_3d_mm2(change)) + 2.0 * 0.3 * float(zero.visual_error(change)))
        states = after
    difference = unsure.value_after_all(flat(), PUSHES) - sure.value_after_all(flat(), PUSHES)
    assert difference == pytest.approx(spent, rel=1e-4) and spent > 0
    between, following = unsure.after_all(flat(), PUSHES[:1])
    assert following.values_after(between, PUSHES[1:])[0] == pytest.approx(
        unsure.value_after_all(flat(), PUSHES), rel=1e-5
    )
    value, gradient = unsure.value_and_gradient(flat(), PUSHES)
    assert value == pytest.approx(unsure.value_after_all(flat(), PUSHES), rel=1e-6)
    way = np.random.default_rng(1).normal(0, 1, PUSHES.shape) * [1e-4, 1e-4, 1e-2, 1e-4, 1e-4]
    low, high = (unsure.value_after_all(flat(), PUSHES + sign * way) for sign in (-1, 1))
    assert 0.5 * (high - low) == pytest.approx(float((gradient * way).sum()), rel=0.02)


def test_single_member_has_no_variance_cost() -> None:
    states = EnsembleRollout([PressedClay()], OBJECTIVE, disagreement_weight=9.0).roll_out(flat(), PUSHES)
    assert EnsembleRollout([PressedClay()], OBJECTIVE, disagreement_weight=9.0).value(states) == float(
        OBJECTIVE.values(states[0])
    )


def test_rollout_without_actions_keeps_the_clay() -> None:
    foresight = EnsembleRollout([PressedClay()], OBJECTIVE, disagreement_weight=0.0)
    np.testing.assert_array_equal(foresight.roll_out(flat(), np.zeros((0, 5)))[0], flat())
    assert foresight.value_and_gradient(flat(), np.zeros((0, 5)))[1].shape == (0, 5)


def test_rollout_rejects_members_of_different_end_effectors() -> None:
    with pytest.raises(ValueError, match="end-effector"):
        EnsembleRollout([PressedClay(), PressedClay(end_effector="edge")], OBJECTIVE, 0.0)
    with pytest.raises(ValueError, match="no push model"):
        EnsembleRollout([], OBJECTIVE, 0.0)


class Hardening(PressedClay):
    """Clay that a tool enters less deeply with every push before."""

    def after(self, height_m, actions, memory=FRESH):  # type: ignore[no-untyped-def]
        return super().after(height_m, actions * [1, 1, 1, 1, 0.5 ** len(memory.actions)])

    def step(self, height_m, action, memory=FRESH):  # type: ignore[no-untyped-def]
        weaker = np.array([1, 1, 1, 1, 0.5 ** len(memory.actions)])
        after, pull = super().step(height_m, action * weaker)
        return after, lambda cotangent: (lambda pair: (pair[0], pair[1] * weaker))(pull(cotangent))


def test_each_push_of_a_sequence_has_the_memory_of_those_before() -> None:
    foresight = EnsembleRollout([Hardening()], OBJECTIVE, disagreement_weight=0.0)
    plain = EnsembleRollout([PressedClay()], OBJECTIVE, disagreement_weight=0.0)
    weaker = PUSHES * [[1, 1, 1, 1, 1], [1, 1, 1, 1, 0.5]]
    np.testing.assert_array_equal(foresight.roll_out(flat(), PUSHES), plain.roll_out(flat(), weaker))
    later = foresight.following(PUSHES[:1])
    np.testing.assert_array_equal(later.roll_out(flat(), PUSHES[1:]), plain.roll_out(flat(), weaker[1:]))
    value, gradient = foresight.value_and_gradient(flat(), PUSHES)
    assert value == foresight.value(foresight.roll_out(flat(), PUSHES))
    way = np.random.default_rng(2).normal(0, 1, PUSHES.shape) * [1e-4, 1e-4, 1e-2, 1e-4, 1e-4]
    low, high = (foresight.value(foresight.roll_out(flat(), PUSHES + sign * way)) for sign in (-1, 1))
    assert 0.5 * (high - low) == pytest.approx(float((gradient * way).sum()), rel=0.02)


def test_memory_counts_pushes_and_keeps_what_else_is_known() -> None:
    memory = PushMemory((), {"order": 3.0, "pushes_since_reset": 0.0, "temperature_c": 21.0}).after(PUSHES[0])
    assert memory.covariates == {"order": 4.0, "pushes_since_reset": 1.0, "temperature_c": 21.0}
    assert len(memory.actions) == 1
