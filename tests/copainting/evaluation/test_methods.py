"""Goals of a planner that changes a part of the canvas."""

import numpy as np
import pytest

from pentimento.copainting.evaluation import methods
from pentimento.copainting.evaluation.methods import complete_canvases, complete_requests
from pentimento.copainting.goal.planner import SeededSampling
from pentimento.copainting.goal.vae import round_trip
from pentimento.deploy.words import taught_vocabulary
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


def test_requests_are_completed_by_windows_of_one_thing_each(monkeypatch: pytest.MonkeyPatch) -> None:
    planner, asked = small_planner(), []

    def complete(_planner: object, canvas: np.ndarray, captions: list[str], sampling: SeededSampling) -> np.ndarray:
        asked.append((captions[0], sampling.seed))
        return np.zeros_like(canvas)

    monkeypatch.setattr(methods, "complete_canvases", complete)
    canvases = np.full((2, 64, 64, 3), 250, np.uint8)
    goals = complete_requests(
        planner, canvases, ["a cat beside a dog", "a fish"], SAMPLING, medium="in colours", has_ink=False,
        vocabulary=taught_vocabulary("named"), largest=0.5,
    )  # fmt: skip
    # The seeds of different goals differ.
    assert asked == [("a cat, in colours", 0), ("a dog, in colours", 1), ("a fish, in colours", 4)]
    assert (goals[0] == 0).mean() == pytest.approx(0.125, abs=0.01)  # two quarters of a quarter
    assert (goals[1] == 0).mean() == pytest.approx(0.25, abs=0.01)
    assert (goals[1][:32, :32] == 0).all()  # in a corner: what follows needs room


def test_request_of_a_planner_that_knows_all_words_is_completed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(methods, "complete_canvases", lambda _p, c, captions, _s: asked.extend(captions) or c)
    canvases = np.full((1, 64, 64, 3), 250, np.uint8)
    goals = complete_requests(
        small_planner(),
        canvases,
        ["florb beside a dog"],
        SAMPLING,
        medium="with a marker",
        has_ink=True,
        vocabulary=None,
    )
    assert asked == ["florb beside a dog, with a marker"] and np.array_equal(goals, canvases)
