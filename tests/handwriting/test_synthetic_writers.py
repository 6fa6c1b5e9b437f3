"""Synthetic writers: lengths of movements, differences between writers, and determinism."""

import numpy as np
import pytest

from pentimento.handwriting.recording import PRESSURE, XY, Z
from pentimento.handwriting.synthetic_writers import HANDS, Movement, SyntheticConfig, synthetic_sessions, trajectory


@pytest.mark.parametrize("turn", [0.0, 1.0, -3.0])
def test_movement_follows_an_arc_of_its_length(turn: float) -> None:
    way = trajectory([Movement(0.02, 0.05, np.log(0.2), 0.25, 0.3, 0.3 + turn)], 2000.0)
    drawn = np.linalg.norm(np.diff(way[:, 1:], axis=0), axis=1).sum()
    assert drawn == pytest.approx(0.02, rel=0.01)
    chord = 0.02 if turn == 0 else 0.02 * np.sin(turn / 2) / (turn / 2)
    assert np.linalg.norm(way[-1, 1:]) == pytest.approx(abs(chord), rel=0.01)


def test_movement_speed_is_lognormal() -> None:
    way = trajectory([Movement(0.02, 0.0, np.log(0.2), 0.25, 0.0, 0.0)], 5000.0)
    fastest = way[np.argmax(np.diff(way[:, 1])), 0]
    assert fastest == pytest.approx(np.exp(np.log(0.2) - 0.25**2), abs=1e-3)  # mode of a lognormal


def test_synthetic_sessions_depend_on_seed_and_writer_only() -> None:
    config = SyntheticConfig(sessions=2, strokes=4, seed=5)
    one, other = synthetic_sessions(config), synthetic_sessions(SyntheticConfig(sessions=3, strokes=6, seed=5))
    assert len(one) == 2 * 4 * len(HANDS)
    counterfactual = next(s for s in other if s.session == one[5].session and np.array_equal(s.points, one[5].points))
    assert counterfactual.hand == one[5].hand  # more sessions and strokes leave the others as they are
    length = {hand: [] for hand in HANDS}
    for stroke in one:
        assert np.isfinite(stroke.points).all()
        assert (stroke.points[:, Z] <= 0).all()
        assert ((stroke.points[:, PRESSURE] >= 0) & (stroke.points[:, PRESSURE] <= 1)).all()
        assert (np.diff(stroke.points[:, 0]) > 0).all()
        length[stroke.hand].append(np.linalg.norm(np.diff(stroke.points[:, XY], axis=0), axis=1).sum())
    assert max(length["dots"]) < min(length["hatching"]) < min(length["arcs"])
    assert len({stroke.session for stroke in one}) == 2 * len(HANDS)
