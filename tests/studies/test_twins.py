"""A twin tells what a cause can explain from what a base gets wrong anyway."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from studies.blind.make import Truth
from studies.blind.strength import Strength
from studies.twins import Pair, page, pair_of

TRUTH = Truth("one", 1, "marker", ("tool_wear",), None, (0.2,), (Strength(1.0, 0.21, 0.01),), misshaped=True)


def judged(base: float, extended: float, *causes: str, floor: float | None = 0.5) -> Any:
    return SimpleNamespace(
        base_losses=np.full(4, base),
        extended_losses=np.full(4, extended),
        floor=None if floor is None else SimpleNamespace(mse=floor),
        established=[SimpleNamespace(cause=cause) for cause in causes],
    )


def test_what_the_effect_adds_is_closed_where_the_extended_model_is_as_good_as_the_twin() -> None:
    pair = pair_of(TRUTH, judged(1.0, 0.75, "tool_wear"), judged(0.75, 0.75))
    assert pair is not None and pair.closed == pytest.approx(0.5) and pair.of_the_effect == pytest.approx(1.0)
    half = pair_of(TRUTH, judged(1.0, 0.9, "tool_wear"), judged(0.8, 0.8))
    assert half is not None and half.closed == pytest.approx(0.2) and half.of_the_effect == pytest.approx(0.5)


@pytest.mark.parametrize(
    "world", [judged(1, 1), judged(1, 0.8, "tool_wear", "latency"), judged(1, 0.8, "tool_wear", floor=None)]
)
def test_what_is_not_named_exactly_or_has_no_floor_is_no_pair(world: Any) -> None:
    assert pair_of(TRUTH, world, judged(0.75, 0.75)) is None


def test_a_page_has_a_row_for_each_world_and_the_medians() -> None:
    text = page([Pair("tool_wear", "marker", True, 0.21, 1.6, 1.3, 1.2)], [], "abc")
    assert "| tool_wear | marker | yes | 0.21 | 1.60 | 1.30 | 1.20 | 0.50 | 0.75 |" in text
    assert "Medians: gap closed 0.50, of the effect 0.75 (least 0.75)." in text and "## Pushes" not in text


def test_an_effect_that_hides_what_a_base_gets_wrong_has_no_share() -> None:
    hidden = Pair("springback", "ball", True, 0.2, 1.3, 1.1, 1.7)
    assert hidden.of_the_effect is None
    text = page([], [hidden, Pair("volume_loss", "ball", False, 0.2, 1.6, 1.3, 1.2)], "abc")
    assert "| 1.30 | 1.10 | 1.70 | 0.67 | – |" in text
    assert "of the effect 0.75 (least 0.75)." in text
