"""L_3D and L_viz have closed forms on planes and constants; holes never count."""

import pytest
import torch

from pentimento.dynamics.pushes.losses import gradient, height_errors, inner, slope_errors

KNOWN = torch.ones(1, 20, 30, dtype=torch.bool)


def test_a_constant_offset_is_a_height_error_and_no_slope_error() -> None:
    offset = torch.full((1, 20, 30), 2e-3)
    assert height_errors(offset, KNOWN).item() == pytest.approx(4.0)
    assert slope_errors(offset, KNOWN, 640.0).item() == pytest.approx(0.0, abs=1e-10)


def test_a_tilt_is_its_slope_squared() -> None:
    tilt = (torch.arange(30) / 640.0 * 0.1 + torch.arange(20)[:, None] / 640.0 * 0.2)[None]
    assert slope_errors(tilt, KNOWN, 640.0).item() == pytest.approx(0.05, rel=1e-3)


def test_differences_are_along_columns_then_rows() -> None:
    ramp = torch.arange(6.0).expand(4, 6)[None]
    across, down = gradient(ramp)[0, :, 1:-1, 1:-1]
    assert (across == 1).all()
    assert (down == 0).all()


def test_what_is_not_known_never_counts() -> None:
    known = KNOWN.clone()
    known[0, 5:8, 7:9] = False
    wild = torch.zeros(1, 20, 30)
    wild[0, 5:8, 7:9] = 1e3
    assert height_errors(wild, known).item() == 0
    assert slope_errors(wild, known, 640.0).item() == 0


def test_a_gradient_is_known_where_all_four_neighbours_are() -> None:
    known = KNOWN.clone()
    known[0, 5, 7] = False
    inside = inner(known)[0]
    assert not inside[0].any()
    assert not inside[[5, 4, 6, 5, 5], [7, 7, 7, 6, 8]].any()
    assert inside[4, 6]
    assert inside.sum() == 18 * 28 - 5
