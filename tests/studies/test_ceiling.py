"""What is left of a gap is measured without the noise of photographs, and is nothing where nothing is missed."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.gap.fit import first_model
from pentimento.gap.foretell import Model, foretold
from pentimento.gap.measured import Measured, load_measured
from studies.blind.ceiling import Line, _misfit, page
from studies.blind.make import Truth
from studies.blind.strength import Strength
from tests.gap.test_habits import photographed

NOISE = 0.02


def executed_again(misfit: float) -> tuple[Model, Any, list[Measured]]:
    """Six times the same strokes, each pixel off by `misfit` times the noise with a sign of its own."""
    measured = load_measured(example_table(24))
    model, rng = first_model(measured), np.random.default_rng(0)
    shape = measured.samples.after.shape
    truth = foretold(model, measured) + misfit * NOISE * rng.choice([-1.0, 1.0], shape)
    again = [photographed(measured, truth + NOISE * rng.standard_normal(shape)) for _ in range(6)]
    return model, SimpleNamespace(measured=measured, splits=SimpleNamespace(test=np.arange(12, 24))), again


@pytest.mark.parametrize("misfit", [0.0, 0.5, 1.0])
def test_what_is_left_is_the_square_of_the_misfit_over_the_noise(misfit: float) -> None:
    model, found, again = executed_again(misfit)
    assert _misfit(model, found, again) == pytest.approx(misfit**2, abs=0.02)


def test_a_page_says_which_share_is_closed_with_and_without_chance() -> None:
    truth = Truth("one", 1, "marker", ("tool_wear",), None, (0.2,), (Strength(1.0, 0.21, 0.01),), misshaped=True)
    text = page([Line(truth, verdict=0.6, base=0.4, extended=0.1, best=0.04)], "abc")
    assert "| tool_wear | marker | yes | 0.21 | 0.60 | 0.10 | 0.75 | 0.04 | 0.90 |" in text
    assert "Medians: verdict 0.60, closed 0.75, with the best habits 0.90." in text
