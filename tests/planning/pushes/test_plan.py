"""Plans of pushes lower the value, stop where no action helps, and are deterministic."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.planning.pushes.config import ends
from pentimento.planning.pushes.initialise import best_action, candidates
from pentimento.planning.pushes.plan import PushPlan, plan, predicted
from pentimento.planning.pushes.refine import cross_entropy, descend
from pentimento.planning.pushes.rollout import EnsembleRollout
from tests.planning.pushes.clay import WINDOW_M, PressedClay, flat
from tests.planning.pushes.settings import CONFIG, REACH

MADE = np.array([[0.03, 0.03, 0.5, 0.025, 0.006], [0.07, 0.06, 2.5, 0.02, 0.005]])


def towards(goal: np.ndarray, strength: float = 1.0) -> EnsembleRollout:
    return EnsembleRollout(
        [PressedClay(strength=strength)], ClayObjective(goal, WINDOW_M, Weights(1.0, 1.0)), disagreement_weight=0.0
    )


REACHABLE = towards(towards(flat()).roll_out(flat(), MADE)[0])
"""A goal that two pushes make exactly."""


def planned(config: object = CONFIG, item: tuple[int, ...] = (0,)) -> PushPlan:
    return plan(flat(), REACHABLE, REACH, config=config, count=4, item=item)  # type: ignore[arg-type]


def test_plan_reaches_a_goal_made_by_pushes() -> None:
    values = planned().values
    assert values[-1] < 0.25 * values[0]
    assert (np.diff(values) < 0).mean() > 0.5


def test_plan_is_empty_at_the_goal() -> None:
    assert len(plan(flat(), towards(flat()), REACH, config=CONFIG, count=4, item=(0,)).actions) == 0


def test_plan_is_empty_where_material_must_rise() -> None:
    goal = flat()
    goal[20:28, 20:28] += 0.002  # pushes that raise anything lower more around it
    choosy = replace(CONFIG, min_relative_gain=0.02)
    assert len(plan(flat(), towards(goal), REACH, config=choosy, count=4, item=(0,)).actions) == 0


def test_plan_depends_on_seed_and_item_only() -> None:
    np.testing.assert_array_equal(planned().actions, planned().actions)
    assert not np.array_equal(planned().actions, planned(item=(1,)).actions)
    assert not np.array_equal(planned().actions, planned(replace(CONFIG, seed=1)).actions)


def test_plan_contains_the_predicted_clay() -> None:
    made = planned()
    again = predicted(made.actions, flat(), REACHABLE)
    np.testing.assert_array_equal(made.predicted_m, again.predicted_m)
    assert made.predicted_m.shape == (len(made.actions) + 1, *flat().shape)
    np.testing.assert_array_equal(made.predicted_m[0], flat())


def test_plan_continues_a_begun_plan_without_useless_actions() -> None:
    useless = np.array([[0.08, 0.02, 0.0, 0.01, 0.008]])  # where the goal is flat
    config = replace(CONFIG, horizon=2, iterations=0)
    kept = plan(flat(), REACHABLE, REACH, config=config, count=2, item=(0,), begun=np.concatenate([useless, MADE]))
    np.testing.assert_array_equal(kept.actions[0], MADE[0])
    assert len(kept.actions) == 2


def test_descent_corrects_displaced_pushes() -> None:
    off = MADE + np.array([0.003, -0.002, 0.2, -0.004, -0.002])
    before = REACHABLE.value(REACHABLE.roll_out(flat(), off))
    moved, value = descend(off, flat(), REACHABLE, reach=REACH, config=replace(CONFIG, iterations=25))
    assert value < 0.2 * before
    assert value == pytest.approx(REACHABLE.value(REACHABLE.roll_out(flat(), moved)))


def test_cross_entropy_corrects_displaced_pushes() -> None:
    off = MADE + np.array([0.003, -0.002, 0.2, -0.004, -0.002])
    before = REACHABLE.value(REACHABLE.roll_out(flat(), off))
    config = replace(CONFIG, iterations=12, samples=30)
    moved, value = cross_entropy(off, flat(), REACHABLE, reach=REACH, config=config, rng=np.random.default_rng(0))
    assert value < 0.6 * before
    assert value == pytest.approx(REACHABLE.value(REACHABLE.roll_out(flat(), moved)))


@pytest.mark.parametrize("refine", ["gradient", "cross_entropy"])
def test_refining_never_raises_the_value(refine: str) -> None:
    rough = planned(replace(CONFIG, refine="none"))
    fine = planned(replace(CONFIG, refine=refine, iterations=2))
    assert fine.values[-1] <= rough.values[-1] + 1e-12


def test_guided_push_candidates_end_on_excess_material() -> None:
    goal = flat()
    goal[8:16, 8:40] -= 0.003  # a bar near the top: rows 8 to 16, so y from .067 to .083
    guided = candidates(
        flat(), towards(goal), REACH, replace(CONFIG, guided_share=1.0, candidates=200), np.random.default_rng(0)
    )
    end_m = ends(guided)
    assert np.mean((end_m[:, 1] > 0.063) & (end_m[:, 1] < 0.088)) > 0.9
    along = np.abs(np.cos(guided[:, 2])) > 0.9
    assert along.mean() > 0.5  # half of them, and of the others some


def test_best_action_is_no_worse_than_first_round_candidates() -> None:
    states = REACHABLE.start(flat())
    first = candidates(flat(), REACHABLE, REACH, CONFIG, np.random.default_rng(5))
    _, value = best_action(states, REACHABLE, REACH, config=CONFIG, rng=np.random.default_rng(5))
    assert value <= REACHABLE.values_after(states, first).min()


def test_a_disagreement_weight_prefers_actions_of_low_ensemble_variance() -> None:
    goal = flat()
    goal[10:20, 10:20] -= 0.003
    goal[30:40, 30:40] -= 0.0031
    members = [PressedClay(), PressedClay()]
    objective = ClayObjective(goal, WINDOW_M, Weights(1.0, 0.0))

    class Unsure(PressedClay):
        """As its sister where y is above the middle, and half as strong where it is below."""

        def after(self, height_m, actions, memory=None):  # type: ignore[no-untyped-def]
            weaker = actions * np.where(actions[:, 1:2] < 0.05, [1, 1, 1, 1, 0.3], 1.0)
            return super().after(height_m, weaker)

    members[1] = Unsure()
    shares = []
    for weight in (0.0, 8.0):
        foresight = EnsembleRollout(members, objective, weight)
        action, _ = best_action(foresight.start(flat()), foresight, REACH, config=CONFIG, rng=np.random.default_rng(0))
        after = foresight.act(foresight.start(flat()), action)
        shares.append(float(np.var(after, axis=0).mean()))
    assert shares[1] < shares[0] or shares[0] == 0.0
    assert shares[1] < 1e-12
