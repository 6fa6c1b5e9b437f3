"""The check on RoboCook's dough: clouds become heights, a push is found again, and without the data it says so."""

import argparse
from pathlib import Path

import numpy as np
import pytest

from pentimento.report.wording import percent
from studies.sculpting import robocook
from studies.sculpting.robocook import (
    CELL_M,
    CELLS,
    Transition,
    best_push,
    heights,
    page,
    pushed,
    transition,
    transitions,
)


def block(seed: int = 0, middle_m: tuple[float, float] = (0.4, -0.1), top_m: float = 0.03) -> np.ndarray:
    """A cloud [N, 3] that fills a block of 60 x 60 mm, 28 mm high, 2 mm above the frame's zero."""
    low, high = (middle_m[0] - 0.03, middle_m[1] - 0.03, 0.002), (middle_m[0] + 0.03, middle_m[1] + 0.03, top_m)
    return np.random.default_rng(seed).uniform(low, high, (20000, 3))


def test_each_cell_has_its_highest_point_and_row_0_is_the_top() -> None:
    found = heights(np.array([[0.001, 0.001, 0.01], [0.002, 0.002, 0.02], [0.1, CELLS * CELL_M - 0.001, 0.03]]))
    assert found[-1, 0] == 0.02 and found[0, int(0.1 / CELL_M)] == 0.03 and np.count_nonzero(found) == 2


def test_same_block_does_not_change_and_one_that_was_carried_is_moved_back() -> None:
    for after, carried in ((block(1), False), (block(1, (0.6, 0.3)) + np.array([0, 0, 0.02]), True)):
        pair = transition(block(), after, "spatula", seed=0)
        assert pair.carried == carried
        assert pair.before_m.max() == pytest.approx(0.029, abs=3e-4)  # 1 mm is left below the lowest point
        inside = (pair.before_m > 0) & (pair.after_m > 0)
        assert inside.sum() >= 15**2 and 1e6 * ((pair.before_m - pair.after_m)[inside] ** 2).mean() < 0.5
        assert 0 < pair.sampling_mm2 < 3


def test_search_finds_a_push_of_the_model_and_less_of_its_reverse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robocook, "ROUNDS", 8)
    before = transition(block(), block(1), "x", seed=0).before_m
    after = pushed(before, np.array([[0.075, 0.09, 0.3, 0.03, 0.012, np.log(0.01)]]))[0]
    assert (after - before).min() < -0.006 and after.min() >= 0
    pair = Transition("push", before, after, False, 0.1)
    nothing = pair.error_mm2(before)
    assert pair.error_mm2(best_push(pair, seed=0).predicted_m) < 0.35 * nothing
    back = pair.reverse
    assert back.error_mm2(back.before_m) == pytest.approx(nothing)
    assert back.error_mm2(best_push(back, seed=0).predicted_m) > 0.5 * nothing


def test_page_counts_what_was_taken_away_apart(tmp_path: Path) -> None:
    clouds = {f"{robocook.SEQUENCE}000": block()}
    for number, tool in enumerate(("press_square", "roller_large", "hook"), 1):
        clouds[f"{robocook.SEQUENCE}{number:03}_{tool}"] = block(number, top_m=0.03 - 0.003 * number)
    np.savez(tmp_path / robocook.FILE, **clouds, alphabet__B__000=block())
    pairs = transitions(tmp_path / robocook.FILE)
    assert [pair.tool for pair in pairs] == ["press_square", "roller_large", "hook"]
    still = [robocook.Found(np.zeros(5), 0.01, pair.before_m) for pair in pairs]
    back = [robocook.Found(np.zeros(5), 0.01, pair.after_m) for pair in pairs]
    text = page(pairs, [pair.before_m for pair in pairs], still, back)
    assert "give 3 transitions" in text and "Of the 2 transitions" in text and "(press_square, roller_large)" in text
    nothing = percent(0.0)
    assert f"removes {nothing} ± {nothing} of the error of no change, backwards {nothing} ± {nothing};" in text


def test_without_the_data_it_says_so_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv(robocook.VARIABLE, raising=False)
    robocook.main(argparse.Namespace(out=tmp_path))
    assert "the check on real dough is left out" in capsys.readouterr().out and not list(tmp_path.iterdir())
