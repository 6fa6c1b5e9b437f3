"""The study of hands: rivals keep what they should, held-out sessions stay apart, measured data is as described."""

import os
from pathlib import Path

import numpy as np
import pytest

from pentimento.handwriting.demonstrated import demonstrated
from pentimento.handwriting.gather import gather
from pentimento.handwriting.repair import Limits
from pentimento.handwriting.synthetic_writers import SyntheticConfig, synthetic_sessions
from pentimento.handwriting.training import Course, TrajVAEConfig
from studies.hands.by_number import auc_by_known_strokes
from studies.hands.held_out import SAMPLERS, held_out_sessions, pretrained_without, told_apart
from studies.hands.page import page
from studies.hands.recordings import motion_capture, quickdraw, tablet
from studies.hands.samplers import copies, gaussian

LIMITS = Limits(5, 3e-3, 8.0, 1e-3, 0.6)
CONFIG = TrajVAEConfig(16, 8, 32, 3e-4, Course(60, 32, 2e-3), Course(40, 10, 1e-3), 0.05, 1)


def arcs(count: int) -> np.ndarray:
    t = np.linspace(0, np.pi, 16)
    height = np.random.default_rng(0).uniform(0.002, 0.01, count)
    return np.stack([np.column_stack([0.03 * t / np.pi, h * np.sin(t)]) for h in height])


def test_the_gaussian_sampler_keeps_mean_and_spread_along_what_varies() -> None:
    few = arcs(20)
    drawn = gaussian(few, 3000, np.random.default_rng(1))
    np.testing.assert_allclose(drawn.mean(0), few.mean(0), atol=2e-4)
    assert drawn[:, 8, 1].std() == pytest.approx(few[:, 8, 1].std(ddof=1), rel=0.1)
    np.testing.assert_allclose(drawn[..., 0], few[0, :, 0] + 0 * drawn[..., 0], atol=1e-9)  # which does not vary


def test_copies_keep_their_ends_and_lie_near_a_demonstration() -> None:
    few = arcs(5)
    drawn = copies(few, 50, np.random.default_rng(1))
    apart = np.linalg.norm(drawn[:, None] - few, axis=-1)
    np.testing.assert_allclose(apart[..., [0, -1]].min(1), 0, atol=1e-9)
    assert 0 < apart.mean(-1).min(1).max() < 0.06 * 0.03


def test_sessions_are_held_out_once_and_told_apart() -> None:
    recorded = synthetic_sessions(SyntheticConfig(sessions=2, strokes=20, seed=4))
    strokes = demonstrated(gather(recorded, LIMITS, 16).table, 16)
    strokes = strokes.pick(np.array([hand == "arcs" for hand in strokes.hand]))
    results = held_out_sessions(pretrained_without(strokes, 20, CONFIG), strokes, few=10, config=CONFIG)
    assert sorted(result.session for result in results) == sorted(set(strokes.session))
    for result in results:
        assert result.measured == 10
        assert result.fine_tuned_mm < result.mean_stroke_mm
        assert set(result.samples_m) == set(SAMPLERS)
        for drawn in result.samples_m.values():
            assert drawn.shape == result.rest_m.shape
            np.testing.assert_allclose(drawn[:, -1, 1], 0, atol=1e-9)  # in the standard frame, as people's are
    auc = told_apart(results, 0)
    assert all(0 <= value <= 1 for value in auc.values())
    assert abs(auc["people, halved"] - 0.5) < 0.3
    text = page(_found(auc), 12)
    assert "| arcs_0 | 8 | 1.00 | 0.50 | 2.00 | 3.00 |" in text
    assert "| arcs_0 | 20 | 8 | 0.90 | 0.60 |" in text


def test_samples_of_a_long_session_are_told_apart_by_how_many_strokes_are_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recorded = synthetic_sessions(SyntheticConfig(sessions=2, strokes=60, seed=4))
    strokes = demonstrated(gather(recorded, LIMITS, 16).table, 16)
    long = [n for n, name in enumerate(strokes.session) if name == "arcs_0"]
    short = [n for n, name in enumerate(strokes.session) if name == "hatching_1"][:26]  # 20 can be known, 40 cannot
    compared: list[tuple[int, int]] = []

    def auc(one: list[np.ndarray], other: list[np.ndarray], _seed: int) -> float:
        compared.append((len(one), len(other)))
        return len(one) / 100

    monkeypatch.setattr("studies.hands.by_number.difference_auc", auc)
    strokes = strokes.pick(np.array(long + short))
    result = auc_by_known_strokes(pretrained_without(strokes, 20, CONFIG), strokes, CONFIG)
    rest = len(long) - 20
    assert [(row.session, row.known, row.measured) for row in result] == [
        ("arcs_0", 20, rest),
        ("arcs_0", 40, rest - 20),
    ]
    assert set(compared) == {(rest, rest), (rest - 20, rest - 20), (min(20, rest - 20),) * 2, (20, 20)}
    assert result[0].auc == pytest.approx(rest / 100)
    assert result[0].auc_of_few == pytest.approx(0.2)


def _found(auc: dict[str, float]) -> dict[str, object]:
    numbers = {"pretrained_mm": 1.0, "fine_tuned_mm": 0.5, "nearest_mm": 2.0, "mean_stroke_mm": 3.0}
    gathered = {"recorded": 3, "kept": 2, "sessions": 1, "faults": {"times_repeated": 1, "spikes_removed": 0}}
    part = {"gathered": gathered, "sessions": [{"session": "arcs_0", "measured": 8, **numbers}], "auc": auc}
    part["auc_by_number"] = [{"session": "arcs_0", "known": 20, "measured": 8, "auc": 0.9, "auc_of_few": 0.6}]
    quick = {"gathered": gathered, "measured": 4, **numbers}
    return {"motion_capture": part, "tablet": part, "quickdraw": quick}


@pytest.mark.skipif("PENTIMENTO_MEASURED" not in os.environ, reason="set PENTIMENTO_MEASURED to the measured data")
def test_measured_trajectories_are_in_metres_with_y_up() -> None:
    folder = Path(os.environ["PENTIMENTO_MEASURED"])
    recorded = motion_capture(folder)
    found = gather(recorded, LIMITS, 32)
    assert found.counts["kept"] > 0.95 * found.counts["recorded"]
    assert found.counts["faults"]["jumps_ending_a_stroke"] == 0  # the fastest session is fast, not broken
    spans = [np.ptp(stroke.points[:, 1:3], axis=0) for stroke in recorded]
    assert np.max(spans) < 0.3
    pen = tablet(folder)
    assert max(stroke.points[:, 2].max() for stroke in pen) <= 0  # y ran down from the top
    assert np.nanmax([stroke.points[:, 4].max() for stroke in pen]) <= 1
    drawn = quickdraw(folder, 5)
    assert len({stroke.session for stroke in drawn}) == 5
    assert all((np.diff(stroke.points[:, 0]) >= 0).all() for stroke in drawn)
