"""Large effects are found before the learned residual model is fitted; small ones are left to the later search."""

import numpy as np
import pytest
import torch

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.candidates import is_large
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.large_effects import _far_refits, find_large
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import Model, UnevenEnds, identity
from pentimento.diagnosis.strokes.predict import predicted
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.latency import Latency
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from pentimento.dynamics.strokes.simulation import Mechanism
from tests.diagnosis.strokes.test_learned_residual import photographed


def strokes_of(kind: type[Mechanism], *values: float) -> tuple[Measured, Model]:
    """Strokes with that in them, each one a little darker or paler than the others, and a first base."""
    measured = load_measured(example_table(40))
    base = fit(first_model(measured), measured)
    mechanism = kind(torch.tensor(values, dtype=torch.float64), identity(kind, measured.context).reference)
    after = predicted(base.plus(mechanism), measured)
    rng = np.random.default_rng(0)
    darker = 1 + 0.05 * rng.standard_normal((len(measured), 1, 1, 1))
    below = measured.samples.before.numpy()
    after = below + darker * (after - below) + 0.01 * rng.standard_normal(after.shape)
    strokes = photographed(measured, after)
    return strokes, fit(first_model(strokes), strokes)


@pytest.mark.parametrize(("distance_m", "large"), [(0.009, True), (0.0004, False)])
def test_finds_lag_that_uneven_ends_could_hide(distance_m: float, large: bool) -> None:
    measured, base = strokes_of(BristleLag, distance_m)
    begun = find_large(
        base,
        measured,
        measured.context,
        noise_share=0.0,
        vocabulary=(BristleLag, PathScale),
        seed=0,
        log=lambda line: None,
    )
    assert begun.found == {"bristle_lag"}
    assert (begun.found == begun.large) == large
    lag = begun.model.mechanisms[-1]
    assert is_large(lag) == large
    assert float(lag.values[0]) == pytest.approx(distance_m, rel=0.1)
    assert not begun.base.mechanisms, "what the lag explains is no freedom of the base"


def test_uneven_ends_without_lag_stay_in_the_base() -> None:
    measured, base = strokes_of(UnevenEnds, -0.0008, 0.0008, 0.3, 0.0)
    begun = find_large(
        base,
        measured,
        measured.context,
        noise_share=0.0,
        vocabulary=(BristleLag, Latency),
        seed=0,
        log=lambda line: None,
    )
    assert begun.found == set()
    assert [m.cause for m in begun.base.mechanisms] == ["uneven_ends"]


def test_finds_lag_larger_than_the_mark() -> None:
    """A test at 0, beside fitted uneven ends, shows nothing of it."""
    strokes, plain = strokes_of(BristleLag, 0.009)
    model = fit(plain.plus(identity(UnevenEnds, strokes.context)), strokes)
    candidates = [identity(kind, strokes.context) for kind in (BristleLag, PathOffset)]
    refits = _far_refits(model, candidates, strokes)
    assert list(refits) == ["bristle_lag"]
    assert float(refits["bristle_lag"].mechanisms[-1].values[0]) == pytest.approx(0.009, rel=0.1)
