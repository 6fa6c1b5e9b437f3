"""Minimum effect of a further cause, and the final comparison with rivals."""

import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.score import Step
from pentimento.diagnosis.strokes.candidates import displaces, evaluate_candidates
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.model import UnevenEnds, identity
from pentimento.diagnosis.strokes.search import (
    Search,
    _hidden_by_ends,
    min_removed,
    recheck_alternatives,
    same_family_suffices,
)
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from pentimento.dynamics.strokes.simulation import Mechanism
from tests.diagnosis.strokes.test_large_effects import strokes_of


def test_further_cause_must_exceed_form_errors_of_others() -> None:
    kinds = (Latency, BristleLag, LensDistortion, SpeedWidth, PathOffset)
    observable: dict[str, Mechanism] = {kind.cause: kind(torch.zeros(len(kind.quantities)), {}) for kind in kinds}
    lag, lens, width = (observable[cause] for cause in ("bristle_lag", "lens_distortion", "speed_width"))
    assert [m.cause for m in observable.values() if not displaces(m)] == ["speed_width"]

    def asked(mechanism: Mechanism, **gained: float) -> float:
        measured = load_measured(example_table(16))
        model = first_model(measured)
        return min_removed(mechanism, 1e-3, Search(model, model, (), observable, {}, 1e-3, gained, frozenset()))

    minimum = asked(lens)
    assert minimum == pytest.approx(1e-5)  # a hundredth of the floor
    assert asked(lens, latency=1.0, speed_width=0.1) > 1e-2
    assert asked(lag, latency=1.0) > asked(lens, latency=1.0)  # one driver
    assert asked(width, latency=1.0) == minimum
    assert asked(lens, path_offset=1.0) == minimum  # the same for all: it has no form


@pytest.mark.parametrize(("taken", "rival"), [(PathScale, PathOffset), (PathOffset, PathScale)])
def test_recheck_keeps_the_best_fitting_cause(taken: type[Mechanism], rival: type[Mechanism]) -> None:
    strokes, plain = strokes_of(PathOffset, 0.0008, -0.0005)
    observable = {kind.cause: identity(kind, strokes.context) for kind in (taken, rival)}
    evidence = evaluate_candidates(plain, list(observable.values()), strokes, seed=0)[0]
    model = fit(plain.plus(observable[taken.cause]), strokes)
    step, last = Step(evidence, taken.cause, (rival.cause,)), Step(evidence, None, ())
    begun = Search(plain, model, (step, last), observable, {}, 0.0, {taken.cause: 1e-4}, frozenset())
    settled = recheck_alternatives(begun, strokes, 0, lambda _: None)
    assert [(s.chosen, s.rivals) for s in settled.steps] == [("path_offset", ()), (None, ())]
    assert settled.found == {"path_offset"} and list(settled.gained) == ["path_offset"]


@pytest.mark.parametrize(("taken", "needless"), [(Latency, True), (BristleLag, False)])
def test_lag_is_needless_beside_sufficient_latency(taken: type[Mechanism], needless: bool) -> None:
    strokes, plain = strokes_of(Latency, 0.05)
    observable = {kind.cause: identity(kind, strokes.context) for kind in (Latency, BristleLag)}
    model = fit(plain.plus(observable[taken.cause]), strokes)
    (other,) = observable.keys() - {taken.cause}
    assert same_family_suffices(other, model, observable, measured=strokes, seed=0) == needless
    assert not same_family_suffices(other, plain, observable, measured=strokes, seed=0)


def test_recheck_replaces_lag_by_latency() -> None:
    """Although latency was not among its rivals."""
    strokes, plain = strokes_of(Latency, 0.05)
    observable = {kind.cause: identity(kind, strokes.context) for kind in (Latency, BristleLag)}
    evidence = evaluate_candidates(plain, list(observable.values()), strokes, seed=0)[0]
    model = fit(plain.plus(observable["bristle_lag"]), strokes)
    begun = Search(
        plain, model, (Step(evidence, "bristle_lag", ()),), observable, {}, 0.0, {"bristle_lag": 1e-4}, frozenset()
    )
    assert recheck_alternatives(begun, strokes, 0, lambda _: None).found == {"latency"}


@pytest.mark.parametrize(("hidden", "seconds", "asked_for"), [(Latency, 0.05, ["latency"]), (BristleLag, 0.005, [])])
def test_finds_latency_hidden_by_uneven_ends(hidden: type[Mechanism], seconds: float, asked_for: list[str]) -> None:
    strokes, plain = strokes_of(hidden, seconds)
    observable = {kind.cause: identity(kind, strokes.context) for kind in (Latency, BristleLag, PathOffset)}
    with_ends = fit(plain.plus(identity(UnevenEnds, strokes.context)), strokes)
    candidates = list(observable.values())
    assert _hidden_by_ends(with_ends, candidates, observable, measured=strokes, seed=0) == asked_for
    assert _hidden_by_ends(plain, candidates, observable, measured=strokes, seed=0) == []
