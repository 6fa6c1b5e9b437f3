"""The third clay flows away from under its tool and keeps its volume."""

import numpy as np
import pytest

from studies.third_clay import session
from studies.third_clay.flow import PIXELS
from studies.third_clay.session import Command, pushed, recorded

LEVEL = np.full((PIXELS, PIXELS), 40.0)
COMMAND = Command(90.0, 100.0, 0.4, 20.0, 5.0)


def change(height_offset_mm: float = 0.0, work_hardening: float = 0.0, worked_mm: float = 0.0) -> np.ndarray:
    """Millimetres [N, N], upwards."""
    worked, rng = np.full_like(LEVEL, worked_mm), np.random.default_rng(0)
    return pushed(LEVEL, worked, COMMAND, height_offset_mm, work_hardening, rng) - LEVEL


def test_a_push_leaves_a_dent_and_rims_of_equal_volume() -> None:
    made = change()
    assert made.min() == pytest.approx(-4.2, abs=0.8)  # it yields too slowly for the whole depth
    assert made.max() > 0.5
    assert abs(made.sum()) < 0.02 * np.abs(made).sum()


def test_hidden_effects_change_the_depth() -> None:
    still = change()
    assert change(height_offset_mm=1.0).min() < still.min() - 0.5
    assert np.array_equal(change(work_hardening=1.0), still)
    assert change(work_hardening=1.0, worked_mm=10.0).min() > still.min() + 0.1


def test_repeats_meet_fresh_slabs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_SLABS", 2)
    monkeypatch.setattr(session, "_REPEATED", 2)
    table = recorded(1).to_pydict()
    _, counts = np.unique(table["action_id"], return_counts=True)
    assert sorted(counts) == [1] * 8 + [3] * 2
    repeats = [k for k, action in enumerate(table["action_id"]) if action >= 8]
    assert all(table["pushes_since_reset"][k] == 0 for k in repeats)
