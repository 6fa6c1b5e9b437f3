"""What rises beside a tool: its slope, where it comes from, where it stands."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.push_dynamics.rims import forward, raised, source


@pytest.fixture
def maps() -> np.ndarray:
    return np.random.default_rng(0).uniform(0, 1, (6, 3, 9, 11)).astype(np.float32)


def test_a_plane_falls_by_its_slope_ahead_up_to_the_edges() -> None:
    rows, columns = np.indices((9, 11)).astype(np.float32)
    x, y = columns, -rows  # row 0 is the top
    heading = np.array([0.0, np.pi / 2, 0.7])
    planes = np.stack([np.float32(-np.cos(h)) * x - np.float32(np.sin(h)) * y for h in heading])
    assert forward(planes, heading) == pytest.approx(np.ones_like(planes), abs=1e-5)
    assert forward(planes, heading + np.pi / 2) == pytest.approx(np.zeros_like(planes), abs=1e-5)


def test_slopes_are_those_of_central_differences(maps: np.ndarray) -> None:
    heading = np.array([0.3, 2.0, -1.2])
    down, right = np.gradient(maps[0], axis=(1, 2))
    told = np.sin(heading)[:, None, None] * down - np.cos(heading)[:, None, None] * right
    assert forward(maps[0], heading) == pytest.approx(told, abs=1e-5)


def test_rims_rise_from_what_stays_pressed_or_from_what_the_tool_takes_below_the_first_surface(
    maps: np.ndarray,
) -> None:
    kept, inside, pressed, before = maps[:4]
    before = before - 0.5
    assert np.array_equal(source(kept, inside, pressed, before, 0.0), kept)
    tool = inside * np.maximum(pressed - before, 0)
    assert source(kept, inside, pressed, before, 1.0) == pytest.approx(tool, abs=1e-6)


def test_rims_stand_outside_the_contact_alone_and_grow_along_the_travel(maps: np.ndarray) -> None:
    near, far, ahead = maps[:3]
    progress, inside = 2 * maps[3] - 1, np.round(maps[4])
    found = raised(near, far, ahead, progress, inside, (0.3, 0.0, 0.8))
    assert (found[inside == 1] == 0).all()
    told = (0.7 * near + 0.3 * far) * np.exp(0.8 * progress)
    assert found[inside == 0] == pytest.approx(told[inside == 0], rel=1e-5)
    heap = raised(near, far, ahead, progress, 0 * inside, (0.3, 2.0, 0.0)) - (0.7 * near + 0.3 * far)
    assert heap == pytest.approx(2 * ahead, abs=1e-5)
