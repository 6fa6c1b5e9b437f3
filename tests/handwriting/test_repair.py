"""Recordings with faults are repaired or refused, and each fault is counted."""

import numpy as np
import pytest

from pentimento.handwriting.recording import XY, Recording, recording
from pentimento.handwriting.repair import Limits, repair, repair_all

LIMITS = Limits(max_gap_samples=5, jump_m=3e-3, jump_factor=8.0, shortest_m=1e-3, longest_m=0.6)


def line(count: int = 40, step_m: float = 5e-4) -> Recording:
    """A straight stroke at 200 Hz."""
    xy = np.column_stack([np.arange(count) * step_m, np.zeros(count)])
    return recording("s", "h", xy, t_s=np.arange(count) / 200, z_m=None, pressure=np.full(count, 0.5))


def test_repair_keeps_a_faultless_recording() -> None:
    repaired = repair(line(), LIMITS)
    assert not repaired.counts
    assert not repaired.removed.any()
    np.testing.assert_array_equal(repaired.strokes[0].points, line().points)


@pytest.mark.parametrize(("missing", "strokes", "fault"), [(3, 1, "holes_bridged"), (9, 2, "holes_ending_a_stroke")])
def test_repair_bridges_short_holes_and_splits_at_long_ones(missing: int, strokes: int, fault: str) -> None:
    source = line()
    source.points[12 : 12 + missing, XY] = np.nan
    repaired = repair(source, LIMITS)
    assert len(repaired.strokes) == strokes
    assert dict(repaired.counts) == {fault: 1}
    assert sum(len(stroke.points) for stroke in repaired.strokes) == 40 - missing


def test_repair_removes_spikes_and_splits_at_jumps() -> None:
    spiked, jumped = line(), line()
    spiked.points[20:22, 2] += 0.05
    jumped.points[20:, 2] += 0.05
    repaired = repair(spiked, LIMITS)
    assert dict(repaired.counts) == {"spikes_removed": 1}
    assert np.flatnonzero(repaired.removed).tolist() == [20, 21]
    assert np.abs(repaired.strokes[0].points[:, 2]).max() == 0
    apart = repair(jumped, LIMITS)
    assert dict(apart.counts) == {"jumps_ending_a_stroke": 1}
    assert [len(stroke.points) for stroke in apart.strokes] == [20, 20]
    assert apart.strokes[1].points[0, 0] == 0  # times count from each stroke's own start


def test_repair_accepts_fast_smooth_movement() -> None:
    """Steps of 5 mm that rise and fall smoothly, as of a hand at 1 m/s."""
    step = 5e-3 * np.sin(np.linspace(0, np.pi, 60)) ** 2
    xy = np.column_stack([np.cumsum(step), np.zeros(60)])
    assert not repair(recording("s", "h", xy, t_s=np.arange(60) / 200), LIMITS).counts


def test_repair_drops_repeated_times_and_invalid_pressure() -> None:
    source = line()
    source.points[10, 0] = source.points[9, 0]
    source.points[30, 4] = 1.7
    repaired = repair(source, LIMITS)
    assert dict(repaired.counts) == {"times_repeated": 1, "pressure_out_of_range": 1}
    (stroke,) = repaired.strokes
    assert (np.diff(stroke.points[:, 0]) > 0).all()
    assert np.isnan(stroke.points[:, 4]).all()  # of a pressure that is partly unknown nothing is claimed


@pytest.mark.parametrize(
    ("xy", "fault"),
    [
        (np.zeros((7, 2)), "strokes_of_one_point"),
        (np.array([[0.0, 0.0], [4e-4, 0.0]]), "strokes_too_short"),
        (
            np.column_stack([np.linspace(0, 400, 500), np.zeros(500)]),
            "strokes_too_long",
        ),  # millimetres taken for metres
    ],
)
def test_repair_refuses_invalid_strokes(xy: np.ndarray, fault: str) -> None:
    limits = Limits(5, 10.0, 8.0, 1e-3, 0.6)
    repaired = repair(recording("s", "h", xy), limits)
    assert repaired.strokes == ()
    assert dict(repaired.counts) == {fault: 1}
    assert repaired.removed.all()


def test_repair_all_sums_counts() -> None:
    spiked = line()
    spiked.points[20, 2] += 0.05
    found = repair_all([line(), spiked, recording("s", "h", np.zeros((3, 2)))], LIMITS)
    assert (len(found.strokes), len(found.faulty)) == (2, 2)
    assert {fault: count for fault, count in found.counts.items() if count} == {
        "spikes_removed": 1,
        "strokes_of_one_point": 1,
    }
