"""Proposed actions separate aliased causes better than random ones, and are executable."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.covariates import PICKUP_COLUMNS
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.experiment_design import Aliasing, design_value, pair_aliasing, questions
from pentimento.diagnosis.strokes.aliasing import columns_of
from pentimento.diagnosis.strokes.candidate_actions import Action, draw_sequence, executable, ranges_of, state_after
from pentimento.diagnosis.strokes.fit import first_model
from pentimento.diagnosis.strokes.jacobian import linearise_rows
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import Model, identity
from pentimento.diagnosis.strokes.next_actions import Proposal, as_table, curvatures, propose
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from tests.diagnosis.strokes.conftest import FOUND, Written

PAIR = ("backlash", "path_offset")
"""Strokes of one heading cannot tell them apart, and the example's are."""


@pytest.fixture(scope="module")
def strokes() -> Measured:
    return load_measured(example_table(40))


@pytest.fixture(scope="module")
def model(strokes: Measured) -> Model:
    kinds = {kind.cause: kind for kind in VOCABULARY}
    return first_model(strokes).plus(*(identity(kinds[cause], strokes.context) for cause in PAIR))


@pytest.fixture(scope="module")
def proposal(model: Model, strokes: Measured) -> Proposal:
    return propose(model, strokes, [PAIR], 0, count=8)


def test_proposal_lowers_aliasing_more_than_random_actions(model: Model, strokes: Measured, proposal: Proposal) -> None:
    before, after = proposal.aliasing[PAIR]
    so_far, ranges = linearise_rows(model, strokes).curvature.sum(0), ranges_of(strokes)
    by_chance = [
        pair_aliasing(so_far + curvatures([actions], model, strokes, ranges)[1][0].sum(0), columns_of(model), PAIR)
        for actions in (draw_sequence(np.random.default_rng(seed), ranges, strokes, 8) for seed in range(7))
    ]
    assert before > 0.95 and after < 0.5
    assert after < 0.7 * float(np.median(by_chance))


def test_proposal_beats_random_designs(model: Model, strokes: Measured, proposal: Proposal) -> None:
    so_far, ranges, columns = linearise_rows(model, strokes).curvature.sum(0), ranges_of(strokes), columns_of(model)

    def value(actions: Sequence[Action]) -> float:
        return design_value(so_far + curvatures([actions], model, strokes, ranges)[1][0].sum(0), columns, [PAIR])

    best = max(value(draw_sequence(np.random.default_rng(seed), ranges, strokes, 8)) for seed in range(12))
    assert value(proposal.actions) > best > design_value(so_far, columns, [PAIR])


def bulge(path: np.ndarray) -> float:
    """How far a path [N, 5] strays from its chord."""
    chord = path[-1, 1:3] - path[0, 1:3]
    away = path[:, 1:3] - path[0, 1:3]
    return float(np.abs(away[:, 0] * chord[1] - away[:, 1] * chord[0]).max() / np.hypot(*chord))


def test_actions_stay_within_recorded_ranges(strokes: Measured, proposal: Proposal) -> None:
    ranges = ranges_of(strokes)
    assert ranges.place_m is not None
    xy = strokes.samples.path[..., 1:3].flatten(0, 1).numpy()
    recorded = max(bulge(path) for path in strokes.samples.path.double().numpy())
    for action in proposal.actions:
        assert (action.path[:, 1:3] >= xy.min(0) - 1e-6).all() and (action.path[:, 1:3] <= xy.max(0) + 1e-6).all()
        assert bulge(action.path) <= recorded + 1e-6
        assert -action.path[:, 3].min() <= -strokes.samples.path[..., 3].min() + 1e-9
        assert (np.diff(action.path[:, 0]) > 0).all()


def test_ink_never_runs_out_between_dips(strokes: Measured, proposal: Proposal) -> None:
    ranges = ranges_of(strokes)
    assert ranges.max_ink_m is not None and proposal.actions[0].reload
    actions, columns = executable(proposal.actions, strokes, ranges)
    since = 0.0
    for action, row in zip(actions, columns, strict=True):
        since = 0.0 if action.reload else since
        assert row["ink_since_reload_m"] == pytest.approx(since, abs=1e-6)
        assert since <= ranges.max_ink_m
        since += np.hypot(*np.diff(action.path[:, 1:3], axis=0).T).sum()
    ages = [row["tool_age_m"] for row in columns]
    assert ages[0] >= state_after(strokes).memory.tool_age_m and (np.diff(ages) > 0).all()


def test_proposal_depends_on_the_seed_only(model: Model, strokes: Measured, proposal: Proposal) -> None:
    again = propose(model, strokes, [PAIR], 0, count=8)
    assert as_table(again, strokes).equals(as_table(proposal, strokes))


def test_proposal_keeps_the_stroke_frame(model: Model, strokes: Measured) -> None:
    """In the stroke's frame all start at the origin, and the heading is fixed."""
    path = strokes.command.clone()
    path[..., 1:3] -= path[:, :1, 1:3]
    top_left = strokes.samples.top_left_m - strokes.command[:, 0, 1:3]
    samples = strokes.samples._replace(path=path, top_left_m=top_left)
    local = replace(strokes, samples=samples, command=path)
    ranges = ranges_of(local)
    assert ranges.place_m is None
    for action in draw_sequence(np.random.default_rng(0), ranges, local, 5):
        np.testing.assert_allclose(action.path[0, 1:3], 0, atol=1e-9)
        assert action.path[-1, 2] == pytest.approx(0, abs=1e-9)


def test_proposal_keeps_constant_press(strokes: Measured) -> None:
    path = strokes.command.clone()
    path[..., 3] = 0.0
    touching = replace(strokes, samples=strokes.samples._replace(path=path), command=path)
    actions = draw_sequence(np.random.default_rng(0), ranges_of(touching), touching, 5)
    assert all((action.path[:, 3] == 0).all() for action in actions)


def test_questions_ask_rivals_then_aliased_causes(written: Written) -> None:
    causes = ("bristle_lag", "latency", "path_scale")
    alone, aliased = np.eye(3), np.eye(3)
    aliased[0, 2] = aliased[2, 0] = 0.97
    rivals = replace(written.result, established=(FOUND,), suspected=())
    assert questions(rivals, Aliasing(causes, alone)) == [("bristle_lag", "latency")]
    assert questions(rivals, Aliasing(causes, aliased)) == [("bristle_lag", "latency"), ("bristle_lag", "path_scale")]
    settled = replace(rivals, established=(replace(FOUND, rivals=()),))
    assert questions(settled, Aliasing(causes, alone)) == [("bristle_lag",)]


def test_single_cause_gains_information(strokes: Measured) -> None:
    kinds = {kind.cause: kind for kind in VOCABULARY}
    model = first_model(strokes).plus(identity(kinds["ink_depletion"], strokes.context))
    proposal = propose(model, strokes, [("ink_depletion",)], 0, count=4)
    so_far = linearise_rows(model, strokes).curvature.sum(0)
    more = so_far + curvatures([proposal.actions], model, strokes, ranges_of(strokes))[1][0].sum(0)
    index = columns_of(model).causes["ink_depletion"]
    variances = [np.diag(np.linalg.pinv(total, hermitian=True))[index] for total in (so_far, more)]
    assert (variances[1] < variances[0]).all()
    assert set(proposal.question) == {("ink_depletion",)} and proposal.aliasing == {}


def test_wet_mixing_is_tested_by_crossing_strokes(strokes: Measured) -> None:
    """Blank paper gives no information about it; where recorded strokes cross, the proposal crosses."""
    age = np.where(np.arange(len(strokes)) % 3 == 0, 20.0, np.nan)
    clean = {name: np.zeros(len(strokes)) for name in PICKUP_COLUMNS}
    wet = replace(strokes, covariates=strokes.covariates | {"wet_age_s": age} | clean)
    kinds = {kind.cause: kind for kind in VOCABULARY}
    model = first_model(wet).plus(identity(kinds["wet_mixing"], wet.context))
    proposal = propose(model, wet, [("wet_mixing",)], 0, count=6)
    index = columns_of(model).causes["wet_mixing"]
    information = curvatures([proposal.actions], model, wet, ranges_of(wet))[1][0][:, index[0], index[0]]
    crosses = np.array([action.crosses for action in proposal.actions])
    assert crosses.sum() >= 2
    assert information[crosses].min() > 100 * information[~crosses].max()
    for before, action in zip(proposal.actions[:-1], proposal.actions[1:], strict=True):
        if action.crosses:
            gaps = np.hypot(*(action.path[:, None, 1:3] - before.path[None, :, 1:3]).transpose(2, 0, 1))
            assert gaps.min() < 0.004
