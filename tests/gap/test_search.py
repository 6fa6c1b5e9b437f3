"""A further cause must be worth something beside others, and in the end the one that fits best stands."""

import pytest
import torch

from pentimento.gap.candidates import displaces, weigh
from pentimento.gap.choice import Step
from pentimento.gap.fit import fit
from pentimento.gap.foretell import identity
from pentimento.gap.search import Search, _enough, _is_kin_of_what_suffices, settle
from pentimento.stroke_dynamics.mechanisms.bristle_lag import BristleLag
from pentimento.stroke_dynamics.mechanisms.latency import Latency
from pentimento.stroke_dynamics.mechanisms.lens_distortion import LensDistortion
from pentimento.stroke_dynamics.mechanisms.path_offset import PathOffset
from pentimento.stroke_dynamics.mechanisms.path_scale import PathScale
from pentimento.stroke_dynamics.mechanisms.speed_width import SpeedWidth
from pentimento.stroke_dynamics.simulation import Mechanism
from tests.gap.test_large import strokes_of


def test_a_further_cause_must_be_worth_something_beside_others_of_its_kind() -> None:
    kinds = (Latency, BristleLag, LensDistortion, SpeedWidth)
    observable: dict[str, Mechanism] = {kind.cause: kind(torch.zeros(len(kind.quantities)), {}) for kind in kinds}
    lag, lens = observable["bristle_lag"], observable["lens_distortion"]
    assert [displaces(mechanism) for mechanism in observable.values()] == [True, True, True, False]
    gained = {"latency": 1.0, "speed_width": 0.1}
    assert _enough(lag, observable, gained) > _enough(lens, observable, gained) > 0  # latency and lag: one driver
    assert _enough(observable["speed_width"], observable, {"latency": 1.0}) == 0


@pytest.mark.parametrize(("taken", "rival"), [(PathScale, PathOffset), (PathOffset, PathScale)])
def test_in_the_end_the_cause_that_fits_best_stands_and_what_fits_worse_is_no_rival(
    taken: type[Mechanism], rival: type[Mechanism]
) -> None:
    strokes, plain = strokes_of(PathOffset, 0.0008, -0.0005)
    observable = {kind.cause: identity(kind, strokes.context) for kind in (taken, rival)}
    evidence = weigh(plain, list(observable.values()), strokes, 0)[0]
    model = fit(plain.plus(observable[taken.cause]), strokes)
    step, last = Step(evidence, taken.cause, (rival.cause,)), Step(evidence, None, ())
    begun = Search(plain, model, (step, last), observable, {}, 0.0, {taken.cause: 1e-4}, frozenset())
    settled = settle(begun, strokes, 0, lambda _: None)
    assert [(s.chosen, s.rivals) for s in settled.steps] == [("path_offset", ()), (None, ())]
    assert settled.found == {"path_offset"} and list(settled.gained) == ["path_offset"]


@pytest.mark.parametrize(("taken", "needless"), [(Latency, True), (BristleLag, False)])
def test_beside_a_delay_that_leaves_nothing_by_speed_no_lag_is_needed(taken: type[Mechanism], needless: bool) -> None:
    strokes, plain = strokes_of(Latency, 0.05)
    observable = {kind.cause: identity(kind, strokes.context) for kind in (Latency, BristleLag)}
    model = fit(plain.plus(observable[taken.cause]), strokes)
    (other,) = observable.keys() - {taken.cause}
    assert _is_kin_of_what_suffices(other, model, observable, strokes, 0) == needless
    assert not _is_kin_of_what_suffices(other, plain, observable, strokes, 0)


def test_in_the_end_a_lag_gives_way_to_a_delay_that_leaves_nothing_by_speed() -> None:
    """Though it was never its rival."""
    strokes, plain = strokes_of(Latency, 0.05)
    observable = {kind.cause: identity(kind, strokes.context) for kind in (Latency, BristleLag)}
    evidence = weigh(plain, list(observable.values()), strokes, 0)[0]
    model = fit(plain.plus(observable["bristle_lag"]), strokes)
    begun = Search(
        plain, model, (Step(evidence, "bristle_lag", ()),), observable, {}, 0.0, {"bristle_lag": 1e-4}, frozenset()
    )
    assert settle(begun, strokes, 0, lambda _: None).found == {"latency"}
