"""Goals of a planner that changes a part of the canvas."""

import numpy as np
import pytest

from pentimento.copainting.evaluation import methods
from pentimento.copainting.evaluation.methods import complete_canvases
from pentimento.copainting.goal.planner import SeededSampling
from pentimento.copainting.goal.vae import round_trip
from tests.copainting.goal_planners import small_pairs, small_planner

SAMPLING = SeededSampling(steps=1, image_guidance=1.0, text_guidance=1.0, seed=0)


def test_completed_canvas_changes_only_where_the_planner_does(monkeypatch: pytest.MonkeyPatch) -> None:
    planner, canvases = small_planner(), np.stack([pair.target for pair in small_pairs(2)])
    again = round_trip(planner.vae, canvases)
    drawn = again.copy()
    drawn[1, :, :8] = 255 - again[1, :, :8]
    given = iter([again, drawn])
    monkeypatch.setattr(methods, "complete", lambda *_: next(given))
    assert np.array_equal(complete_canvases(planner, canvases, ["a", "b"], SAMPLING), canvases)
    goals = complete_canvases(planner, canvases, ["a", "b"], SAMPLING)
    assert np.array_equal(goals[0], canvases[0]) and np.array_equal(goals[1, :, 12:], canvases[1, :, 12:])
    assert (goals[1, :, :8] != canvases[1, :, :8]).any()
