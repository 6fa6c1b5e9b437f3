"""Pairs of simulated worlds with and without the effect."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from studies.blind.counterfactuals import Pair, page, pair_of
from studies.blind.truth import Strength, Truth

TRUTH = Truth("one", 1, "marker", ("tool_wear",), None, (0.2,), (Strength(1.0, 0.21, 0.01),), misshaped=True)


def diagnosis(base: float, extended: float, *causes: str, floor: float | None = 0.5) -> Any:
    return SimpleNamespace(
        base_losses=np.full(4, base),
        extended_losses=np.full(4, extended),
        floor=None if floor is None else SimpleNamespace(mse=floor),
        established=[SimpleNamespace(cause=cause) for cause in causes],
    )


def test_fraction_of_the_effect_is_relative_to_the_counterfactual_error() -> None:
    pair = pair_of(TRUTH, diagnosis(1.0, 0.75, "tool_wear"), diagnosis(0.75, 0.75))
    assert pair is not None and pair.closed == pytest.approx(0.5) and pair.of_the_effect == pytest.approx(1.0)
    half = pair_of(TRUTH, diagnosis(1.0, 0.9, "tool_wear"), diagnosis(0.8, 0.8))
    assert half is not None and half.closed == pytest.approx(0.2) and half.of_the_effect == pytest.approx(0.5)


@pytest.mark.parametrize(
    "world", [diagnosis(1, 1), diagnosis(1, 0.8, "tool_wear", "latency"), diagnosis(1, 0.8, "tool_wear", floor=None)]
)
def test_no_pair_without_exact_name_or_noise_floor(world: Any) -> None:
    assert pair_of(TRUTH, world, diagnosis(0.75, 0.75)) is None


def test_page_has_a_row_for_each_world_and_the_medians() -> None:
    text = page([Pair("tool_wear", "marker", True, 0.21, 1.6, 1.3, 1.2)], [], "abc")
    assert "| tool_wear | marker | yes | 0.21 | 1.60 | 1.30 | 1.20 | 0.50 | 0.75 |" in text
    assert "Medians: gap closed 0.50, of the effect 0.75 (min 0.75)." in text and "## Pushes" not in text


def test_effect_that_adds_no_error_has_no_fraction() -> None:
    hidden = Pair("springback", "ball", True, 0.2, 1.3, 1.1, 1.7)
    assert hidden.of_the_effect is None
    text = page([], [hidden, Pair("volume_loss", "ball", False, 0.2, 1.6, 1.3, 1.2)], "abc")
    assert "| 1.30 | 1.10 | 1.70 | 0.67 | – |" in text
    assert "of the effect 0.75 (min 0.75)." in text
