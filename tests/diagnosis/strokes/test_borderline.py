"""Causes that discovery and confirmation split support together."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.diagnosis.score import Step
from pentimento.diagnosis.strokes.candidates import FIRST_P, evaluate_candidates
from pentimento.diagnosis.strokes.fit import fit
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model, identity
from pentimento.diagnosis.strokes.search import Search, accept_borderline, confirmation_p
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from tests.diagnosis.strokes.test_large_effects import strokes_of


def halves(strokes: Measured) -> tuple[Measured, NDArray[np.bool_]]:
    """The strokes to search, and which actions of all are the others."""
    fresh = np.unique(strokes.action) % 2 == 1
    return strokes.pick(np.flatnonzero(strokes.action % 2 == 0)), fresh


def ended(discovery_split: Measured, model: Model, p_adjusted: float) -> Search:
    """A search without causes, in which an offset is borderline."""
    observable = {kind.cause: identity(kind, discovery_split.context) for kind in (PathOffset, PathScale)}
    evidence = evaluate_candidates(model, list(observable.values()), discovery_split, seed=0)[0]
    evidence["path_offset"] = evidence["path_offset"]._replace(p_adjusted=p_adjusted, gain=0.1)
    evidence["path_scale"] = evidence["path_scale"]._replace(p_adjusted=0.9)
    return Search(model, model, (Step(evidence, None, ()),), observable, {}, 0.0, {}, frozenset())


@pytest.mark.parametrize(("p_adjusted", "named"), [(0.1, True), (0.4, False)])
def test_accepts_borderline_cause_that_confirmation_supports(p_adjusted: float, named: bool) -> None:
    strokes, _ = strokes_of(PathOffset, 0.0, 0.0004)
    discovery_split, fresh = halves(strokes)
    _, plain = strokes_of(PathOffset, 0.0, 0.0)
    begun = ended(discovery_split, fit(plain, discovery_split), p_adjusted)
    found = accept_borderline(begun, discovery_split, strokes, fresh=fresh, seed=0, log=lambda _: None)
    assert found.found == ({"path_offset"} if named else frozenset())
    if named:
        assert [step.chosen for step in found.steps] == ["path_offset", None]
        assert found.steps[0].evidence["path_offset"].p_adjusted < FIRST_P
        assert found.gained["path_offset"] > 0


def test_rejects_borderline_cause_without_confirmation() -> None:
    """The confirmation split has no offset."""
    with_offset, _ = strokes_of(PathOffset, 0.0, 0.0004)
    without, plain = strokes_of(PathOffset, 0.0, 0.0)
    _, fresh = halves(without)
    discovery_split = halves(with_offset)[0]
    after = without.samples.after.clone()
    in_discovery_split = without.action % 2 == 0
    after[in_discovery_split] = with_offset.samples.after[in_discovery_split]
    known = replace(without, samples=without.samples._replace(after=after))
    begun = ended(discovery_split, fit(plain, discovery_split), 0.1)
    assert accept_borderline(begun, discovery_split, known, fresh=fresh, seed=0, log=lambda _: None) is begun


def test_confirmation_tests_the_fitted_direction() -> None:
    strokes, plain = strokes_of(PathOffset, 0.0008, 0.0)
    discovery_split, fresh = halves(strokes)
    model = fit(plain.plus(identity(PathOffset, strokes.context)), discovery_split)
    assert confirmation_p(model, "path_offset", strokes, fresh=fresh, seed=0) < 0.01
    other_way = model.at(np.where(np.arange(len(model.vector)) >= model.nuisances, -model.vector, model.vector))
    assert confirmation_p(other_way, "path_offset", strokes, fresh=fresh, seed=0) > 0.5
