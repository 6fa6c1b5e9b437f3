"""One hidden effect of each family of causes is named; nothing is named without one."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.pushes.problem import PushResult, push_problem
from pentimento.planning.pushes.analytic.mechanisms import VOCABULARY, Mechanism
from pentimento.planning.pushes.analytic.mechanisms.mechanism import Motion
from pentimento.planning.pushes.analytic.scene import PushScene
from tests.dynamics.pushes.played_pushes import blank, mechanism, played

ACTIONS = 28
"""49 pushes of 35 actions, 7 of them repeated."""
HIDDEN: dict[str, dict[str, float]] = {
    "adhesion_lift": {"lift_by_log_speed_m": 6e-4},
    "far_field": {"share": 0.4},
    "height_offset": {"lower_m": 1e-3},
    "slope_slide": {"slid_to_31_degrees": 1.0},
    "springback": {"kept_by_log_dwell": 0.15},
    "stiffness_drift": {"by_half_session": 0.5},
    "tool_backlash": {"x_m": 1e-3},
    "volume_loss": {"lost_share": 0.6},
    "work_hardening": {"loss": 1.0},
}
"""Of each cause, which are a family each: about twice the typical size; more of what only a few old grooves show."""
PER_RESET = {"work_hardening": 12}
"""Pushes between two smoothings, where five rarely meet."""


class DeeperWhenHumid(Mechanism):
    """An effect without a name: the depth grows with the air's humidity."""

    cause: ClassVar[str] = "humid"
    site = "command"
    driving_covariate = "air"
    quantities = ()

    @property
    def active(self) -> bool:
        return True

    def motion(self, motion: Motion, scene: PushScene) -> Motion:
        return motion._replace(log_depth=motion.log_depth + 2.0 * (scene.covariates["humidity"] - 0.4))


def diagnosed(*hidden: Mechanism, per_reset: int = 5) -> PushResult:
    problem = push_problem(measure(played(hidden, ACTIONS, per_reset=per_reset)), VOCABULARY, 0)
    return diagnose(problem, seed=0, log=lambda line: None)


def established(result: PushResult) -> set[str]:
    return {finding.cause for finding in result.established}


def named(result: PushResult) -> set[str]:
    """Established or suspected: 35 actions establish few causes of pushes."""
    return {finding.cause for finding in (*result.established, *result.suspected)}


@pytest.mark.timeout(900)
def test_one_hidden_effect_of_each_family_is_named() -> None:
    kinds = {kind.cause: kind for kind in VOCABULARY}
    assert set(HIDDEN) == set(kinds)
    results = {}
    for cause, values in HIDDEN.items():
        hidden = mechanism(kinds[cause], blank(ACTIONS), **values)
        results[cause] = diagnosed(hidden, per_reset=PER_RESET.get(cause, 5))
    found = {cause: named(result) for cause, result in results.items()}
    assert sum(names == {cause} for cause, names in found.items()) >= len(found) - 1, found
    assert not any(established(result) - {cause} for cause, result in results.items())


def test_nothing_is_named_where_nothing_is_hidden() -> None:
    result = diagnosed()
    assert not established(result) and not result.structure.unexplained
    assert result.floor is not None
    assert result.extended_losses.mean() == pytest.approx(result.floor.mse, rel=0.3)


def test_effect_outside_the_vocabulary_is_named_by_mode_and_covariate() -> None:
    result = diagnosed(DeeperWhenHumid(np.zeros(0), {}))
    assert not established(result)
    assert [(left.mode, left.covariate) for left in result.structure.unexplained[:1]] == [("depth", "humidity")]
