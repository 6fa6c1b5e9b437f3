"""Finding the surface: within its error, never deeper than the first touch, and saying when it cannot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.calibration.touch import touch_height, touch_plane
from pentimento.contracts.errors import CalibrationError

PROPERTY = settings(max_examples=100, deadline=None, derandomize=True, database=None)


@PROPERTY
@given(
    surface_m=st.floats(-0.0009, 0.0029),
    step_m=st.floats(2e-4, 1e-3),
    within_m=st.floats(1e-5, 2e-4),
)
def test_the_surface_is_found_within_half_the_bracket(surface_m: float, step_m: float, within_m: float) -> None:
    asked: list[float] = []

    def touches(z_m: float) -> bool:
        asked.append(z_m)
        return z_m <= surface_m

    found_m = touch_height(touches, 0.003, -0.001, step_m, within_m)
    assert abs(found_m - surface_m) <= within_m / 2 + 1e-12
    assert min(asked) >= max(surface_m - step_m, -0.001) - 1e-12
    assert len(asked) <= np.ceil(0.004 / step_m) + 2 + np.ceil(np.log2(step_m / within_m)) + 1


def test_touch_search_rejects_contact_at_once_or_never() -> None:
    with pytest.raises(CalibrationError, match=r"touches already at 3\.00 mm"):
        touch_height(lambda _: True, 0.003, -0.001, 5e-4, 1e-4)
    asked: list[float] = []
    with pytest.raises(CalibrationError, match=r"does not touch down to -1\.00 mm"):
        touch_height(lambda z: bool(asked.append(z)), 0.003, -0.001, 7e-4, 1e-4)
    assert min(asked) == -0.001
    with pytest.raises(CalibrationError, match="downwards"):
        touch_height(lambda _: False, -0.001, 0.003, 5e-4, 1e-4)


def test_a_plane_is_recovered_with_its_residual() -> None:
    rng = np.random.default_rng(0)
    places_m = rng.uniform(0, 0.3, (8, 2))
    heights_m = 0.001 + places_m @ [0.004, -0.002]
    plane, residual_m = touch_plane(places_m, heights_m)
    assert plane == pytest.approx((0.001, 0.004, -0.002)) and residual_m < 1e-12
    bent = heights_m.copy()
    bent[3] += 1e-3
    assert 3e-4 < touch_plane(places_m, bent)[1] <= 1e-3


@pytest.mark.parametrize("places_m", [np.zeros((5, 2)), np.linspace(0, 0.2, 10).reshape(5, 2), np.eye(3, 2)])
def test_places_that_fix_no_plane_are_refused(places_m: np.ndarray) -> None:
    with pytest.raises(CalibrationError, match="four places"):
        touch_plane(places_m, np.zeros(len(places_m)))
