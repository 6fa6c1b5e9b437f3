"""Pellets in the clay studio: volume, compaction, and refused requests."""

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.studio.clay.pellet import lump_m
from pentimento.studio.clay.studio import ClayStudio
from tests.studio.clay.clay_worlds import SURFACE_M, clay_with

VOLUME_M3 = 5e-7
CELL_M = 0.1 / 96


def placed(studio: ClayStudio, volume_m3: float = VOLUME_M3, press_m: float = 0.002) -> np.ndarray:
    before = studio.truth_height_m()
    studio.place(0.05, 0.05, volume_m3, surface_m=SURFACE_M, press_m=press_m)
    return studio.truth_height_m() - before


@pytest.mark.parametrize("ratio", [1.0, 1.2])
def test_lump_holds_its_volume_and_turns_with_its_angle(ratio: float) -> None:
    flat = lump_m((96, 96), (47.5, 47.5), VOLUME_M3, ratio, 0.0, CELL_M)
    turned = lump_m((96, 96), (47.5, 47.5), VOLUME_M3, ratio, np.pi / 2, CELL_M)
    assert flat.sum() * CELL_M**2 == pytest.approx(VOLUME_M3, rel=1e-12)
    np.testing.assert_allclose(turned, np.rot90(flat), atol=1e-15)
    np.testing.assert_allclose(flat, flat[::-1, ::-1], atol=1e-15)
    # The middle of a ball is as thick as its diameter.
    if ratio == 1.0:
        assert flat.max() == pytest.approx((6 * VOLUME_M3 / np.pi) ** (1 / 3), rel=0.02)


def test_pellet_that_is_not_crushed_adds_its_volume() -> None:
    studio = ClayStudio(clay_with(far_field=1.0, adhesion_lift=1.0, springback=1.0), 1)
    change = placed(studio)
    assert studio.lost_m3 == 0.0
    assert change.sum() * CELL_M**2 == pytest.approx(studio.added_m3, rel=1e-9)
    assert studio.added_m3 == pytest.approx(VOLUME_M3, rel=0.25)  # five standard deviations


def test_crushed_pellet_adds_less_by_what_it_loses() -> None:
    studio = ClayStudio(clay_with(volume_loss=1.0), 1)
    change = placed(studio)
    assert 0.1 * VOLUME_M3 < studio.lost_m3 < VOLUME_M3
    assert change.sum() * CELL_M**2 == pytest.approx(studio.added_m3 - studio.lost_m3, rel=1e-9)


def test_pellet_pressed_lower_is_wider() -> None:
    high, low = (placed(ClayStudio(clay_with(), 1), press_m=press_m) for press_m in (0.006, 0.002))
    assert high.max() > low.max() > 0.001
    assert (low > 5e-4).sum() > (high > 5e-4).sum()


def test_pellets_differ_in_place_and_volume_and_pushes_do_not_notice() -> None:
    one, other = ClayStudio(clay_with(), 1), ClayStudio(clay_with(), 2)
    assert np.abs(placed(one) - placed(other)).max() > 1e-4
    assert one.added_m3 != other.added_m3
    # A pellet draws from its own random stream: the scan after it has the noise that it would have without it.
    bare = ClayStudio(clay_with(), 1)
    noise = [studio.scan().height_m[:5, :5] for studio in (one, bare)]
    np.testing.assert_array_equal(*noise)


@pytest.mark.parametrize(
    "request_",
    [
        {"x_m": 0.2, "y_m": 0.05, "volume_m3": VOLUME_M3, "surface_m": 0.04, "press_m": 0.002},
        {"x_m": 0.05, "y_m": 0.05, "volume_m3": 0.0, "surface_m": 0.04, "press_m": 0.002},
        {"x_m": 0.05, "y_m": float("nan"), "volume_m3": VOLUME_M3, "surface_m": 0.04, "press_m": 0.002},
        {"x_m": 0.05, "y_m": 0.05, "volume_m3": VOLUME_M3, "surface_m": 0.04, "press_m": -0.002},
    ],
)
def test_broken_pellet_is_refused_and_leaves_the_clay(request_: dict[str, float]) -> None:
    studio = ClayStudio(clay_with(), 1)
    before = studio.truth_height_m()
    with pytest.raises(ContractError, match="A pellet needs a place"):
        studio.place(**request_)
    np.testing.assert_array_equal(studio.truth_height_m(), before)
