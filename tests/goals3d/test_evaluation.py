"""Errors of a sculpture against its goal, and the letter classifier."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.goals3d.evaluation import goal_errors
from pentimento.goals3d.reliefs import letter_relief, place, soften
from pentimento.planning.objectives import ClayObjective, Weights
from pentimento.semantics.letter_classifier import LetterClassifier
from studies.sculpting.alphabet import fonts_of_other_families

GOAL = np.random.default_rng(0).normal(0.04, 1e-3, (20, 20)).astype(np.float32)
OBJECTIVE = ClayObjective(GOAL, (0.0, 0.0, 0.02, 0.02), Weights(1.0, 1.0))
START = np.full((20, 20), 0.04, np.float32)
LETTERS = "ABCDEF"


def test_reached_goal_has_zero_error() -> None:
    errors = goal_errors(OBJECTIVE, np.stack([START, GOAL]), GOAL)
    for name in ("error_3d_mm2", "visual_error"):
        assert errors[name]["before"] > 0 and errors[name]["after"] == errors[name]["planned"] == 0
        assert errors[name]["removed"] == 1


def test_halfway_leaves_quarter_of_squared_error() -> None:
    errors = goal_errors(OBJECTIVE, np.stack([START, (START + GOAL) / 2]), START)
    assert errors["error_3d_mm2"]["removed"] == pytest.approx(0.75, rel=1e-4)
    assert errors["error_3d_mm2"]["planned"] == errors["error_3d_mm2"]["before"]


def test_reports_worsening_and_minimum_error() -> None:
    worse = 2 * START - GOAL + np.float32(0.001)
    errors = goal_errors(OBJECTIVE, np.stack([START, (START + GOAL) / 2, worse]), START)["error_3d_mm2"]
    assert errors["removed"] < 0 and errors["minimum"] < errors["before"] < errors["after"]


@pytest.fixture(scope="module")
def classifier() -> LetterClassifier:
    return LetterClassifier(LETTERS, examples=30, seed=0)


def sunk(letter: str, seed: int = 0) -> np.ndarray:
    relief = soften(place(letter_relief(letter, 128), (128, 128), 0.68), 2.0)
    noise = np.random.default_rng(seed).normal(0, 1e-4, relief.shape)
    return (0.04 + 0.004 * relief + noise).astype(np.float32)


def test_classifies_rendered_letters(classifier: LetterClassifier) -> None:
    assert "".join(classifier.classify(sunk(letter), 0.1).letter for letter in LETTERS) == LETTERS


def test_classification_ignores_depth_and_level(classifier: LetterClassifier) -> None:
    assert classifier.classify(0.5 * sunk("B"), 0.1).letter == "B"


def test_classifies_letter_over_traces_of_another(classifier: LetterClassifier) -> None:
    assert classifier.classify((sunk("D") + 0.3 * (sunk("A") - 0.04)).astype(np.float32), 0.1).letter == "D"


def test_level_clay_has_low_probability(classifier: LetterClassifier) -> None:
    level = (0.04 + np.random.default_rng(1).normal(0, 1e-4, (128, 128))).astype(np.float32)
    assert classifier.classify(level, 0.1).probability < 0.9
    assert classifier.classify(sunk("E"), 0.1).probability > classifier.classify(level, 0.1).probability


def test_classifier_is_reproducible(classifier: LetterClassifier) -> None:
    again = LetterClassifier(LETTERS, examples=30, seed=0)
    assert again.classify(sunk("C"), 0.1) == classifier.classify(sunk("C"), 0.1)


def test_reads_letters_of_a_font_that_it_was_not_trained_on() -> None:
    reader = LetterClassifier(LETTERS, examples=30, seed=0, fonts=fonts_of_other_families())
    assert "".join(reader.classify(sunk(letter), 0.1).letter for letter in LETTERS) == LETTERS
