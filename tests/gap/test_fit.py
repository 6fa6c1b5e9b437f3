"""What a fit ends at, and what its base can take back of a cause."""

import numpy as np
import pytest

from pentimento.gap.fit import fit, held
from pentimento.gap.foretell import Model, action_losses, identity
from pentimento.gap.jacobian import Statistics, linearise
from pentimento.gap.measured import Measured
from pentimento.gap.score import projected
from pentimento.stroke_dynamics.mechanisms.canvas_tilt import CanvasTilt
from tests.gap.test_large import strokes_of


@pytest.fixture(scope="module")
def tilted() -> tuple[Measured, Model]:
    """Strokes on a canvas that is tilted, and the model that was fitted to them with that cause."""
    strokes, plain = strokes_of(CanvasTilt, 0.0002, 0.0)
    return strokes, fit(plain.plus(identity(CanvasTilt, strokes.context)), strokes)


def asked(statistics: Statistics, model: Model) -> float:
    """How much error would come back, to second order, were the cause taken away and the rest fitted anew."""
    columns = model.columns_of(CanvasTilt.cause)
    rest = np.setdiff1d(np.arange(len(model.vector)), columns)
    values = model.vector[columns]
    return float(values @ projected(statistics, rest, columns)[1].mean(0) @ values)


def test_the_base_takes_back_of_a_cause_no_more_than_a_fit_without_it_does(tilted: tuple[Measured, Model]) -> None:
    """With strokes alone, giant steps of the profile against the widths would seem to undo most of it."""
    strokes, model = tilted
    without = fit(model.without(CanvasTilt.cause), strokes)
    comes_back = float((action_losses(without, strokes) - action_losses(model, strokes)).mean())
    statistics = linearise(model, strokes)
    assert asked(held(statistics, model), model) == pytest.approx(comes_back, rel=0.3)
    assert asked(statistics, model) < 0.5 * comes_back


def test_at_its_end_a_fit_is_pulled_nowhere(tilted: tuple[Measured, Model]) -> None:
    strokes, model = tilted
    slope = held(linearise(model, strokes), model).slope
    assert np.abs(slope.sum(0)).max() < 0.02 * np.abs(slope).sum(0).max()
