"""What a fit ends at, and what its base can take back of a cause."""

import numpy as np
import pytest

from pentimento.gap.fit import fit, held, steadied
from pentimento.gap.foretell import Model, action_losses, identity
from pentimento.gap.jacobian import Statistics, linearise
from pentimento.gap.measured import Measured
from pentimento.gap.score import projected
from pentimento.gap.trees import like_causes
from pentimento.stroke_dynamics.mechanisms.speed_bleed import SpeedBleed
from tests.gap.test_large import strokes_of


@pytest.fixture(scope="module")
def softened() -> tuple[Measured, Model]:
    """Strokes whose edge is softer the faster they are, and the model that was fitted to them with that cause."""
    strokes, plain = strokes_of(SpeedBleed, 0.3, 0.0)
    return strokes, fit(plain.plus(identity(SpeedBleed, strokes.context)), strokes)


def asked(statistics: Statistics, model: Model) -> float:
    """How much error would come back, to second order, were the cause taken away and the rest fitted anew."""
    columns = model.columns_of(SpeedBleed.cause)
    rest = np.setdiff1d(np.arange(len(model.vector)), columns)
    values = model.vector[columns]
    return float(values @ projected(statistics, rest, columns)[1].mean(0) @ values)


def test_the_base_takes_back_of_a_cause_no_more_than_a_fit_without_it_does(softened: tuple[Measured, Model]) -> None:
    """With strokes alone, steps that no fit would take would seem to undo more of it."""
    strokes, model = softened
    without = fit(model.without(SpeedBleed.cause), strokes)
    comes_back = float((action_losses(without, strokes) - action_losses(model, strokes)).mean())
    statistics = linearise(model, strokes)
    assert asked(held(statistics, model), model) == pytest.approx(comes_back, rel=0.3)
    assert asked(statistics, model) < 0.9 * asked(held(statistics, model), model)


def test_at_its_end_a_fit_is_pulled_nowhere(softened: tuple[Measured, Model]) -> None:
    strokes, model = softened
    slope = held(linearise(model, strokes), model).slope
    assert np.abs(slope.sum(0)).max() < 0.02 * np.abs(slope).sum(0).max()


def test_what_strokes_leave_open_is_not_anything(softened: tuple[Measured, Model]) -> None:
    """No stroke presses as lightly as the first half-width is for, but for a breath on one."""
    strokes, model = softened
    statistics = linearise(model, strokes)
    curvature, slope = statistics.curvature.copy(), statistics.slope.copy()
    curvature[:, 0], curvature[:, :, 0], slope[:, 0] = 0.0, 0.0, 0.0
    curvature[0, 0, 0], slope[0, 0] = 1e-12, 1e-11  # ten millimetres, if nothing holds them
    opened = Statistics(curvature, slope, statistics.energy)
    assert like_causes(opened, model.nuisances)[0] > 5.0
    assert abs(like_causes(steadied(opened, model, 0.001), model.nuisances)[0]) < 0.5
