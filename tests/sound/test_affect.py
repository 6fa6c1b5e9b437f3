"""From how something is said to valence and arousal, and from these to a way of painting."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pentimento.control.expression import PLAIN
from pentimento.sound.affect import Affect, Heard, affect_of, expression_of, expression_of_affect, in_words
from pentimento.sound.manner import Manner

ORDINARY = Manner(loudness_db=28.0, pitch_hz=150.0, pitch_range_st=4.0, pace_hz=4.5)
UNKNOWN = Manner(math.nan, math.nan, math.nan, math.nan)
CUES = {"loudness_db": (6, 12, 18, 28, 38, 44, 50), "pitch_range_st": (1, 2, 4, 8, 16), "pace_hz": (2, 3, 4, 6, 9)}


@pytest.mark.parametrize("manner", [ORDINARY, UNKNOWN, replace(ORDINARY, pitch_hz=300.0)])
def test_an_ordinary_statement_changes_nothing(manner: Manner) -> None:
    assert affect_of(manner) == Affect(0.0, 0.0) and in_words(manner) == ""
    assert expression_of(Heard("a cat", manner), free_colours=True) == PLAIN


def test_a_sound_that_is_no_speech_changes_nothing() -> None:
    assert expression_of(Heard("a cat"), free_colours=True) == PLAIN


@pytest.mark.parametrize("cue", CUES)
def test_arousal_rises_with_each_cue_and_stays_within_its_ends(cue: str) -> None:
    arousals = [affect_of(replace(ORDINARY, **{cue: value})).arousal for value in CUES[cue]]
    assert all(low <= high for low, high in pairwise(arousals))
    assert arousals[0] == pytest.approx(-0.5, abs=0.1) and arousals[-1] == pytest.approx(0.5, abs=0.01)
    extreme = Manner(90.0, 400.0, 40.0, 20.0)
    assert affect_of(extreme).arousal == 1.0 and affect_of(Manner(0.0, 80.0, 0.1, 0.5)).arousal == -1.0


def test_valence_is_small_and_heard_in_the_pitch_range_alone() -> None:
    assert affect_of(replace(ORDINARY, loudness_db=90.0, pace_hz=12.0)).valence == 0.0
    assert affect_of(replace(ORDINARY, pitch_range_st=20.0)).valence == pytest.approx(0.3)
    assert affect_of(replace(ORDINARY, pitch_range_st=0.5)).valence == pytest.approx(-0.3)


@pytest.mark.parametrize("affect", [Affect(0.3, 1.0), Affect(-0.3, -1.0), Affect(0.0, 0.5), Affect(0.1, -0.2)])
def test_colours_evoke_the_emotion_by_the_published_regression(affect: Affect) -> None:
    expression = expression_of_affect(affect)
    brightness, saturation = expression.lightness / 12.0, math.log(expression.chroma) / math.log(1.32)
    assert 0.69 * brightness + 0.22 * saturation == pytest.approx(affect.valence)
    assert -0.31 * brightness + 0.60 * saturation == pytest.approx(affect.arousal)


def test_strokes_are_as_much_longer_and_faster_when_excited_as_they_are_shorter_and_slower_when_calm() -> None:
    calm, excited = expression_of_affect(Affect(0.0, -0.7)), expression_of_affect(Affect(0.0, 0.7))
    assert excited.length > 1 and excited.tempo > 1 and excited.chroma > 1
    assert np.array([calm.length, calm.tempo, calm.chroma]) * (
        excited.length, excited.tempo, excited.chroma
    ) == pytest.approx(1.0)  # fmt: skip


def test_a_tool_with_ink_keeps_its_colour() -> None:
    heard = Heard("a cat", replace(ORDINARY, pace_hz=9.0))
    free, ink = (expression_of(heard, free_colours=free) for free in (True, False))
    assert free.chroma > 1 and (ink.chroma, ink.lightness) == (1.0, 0.0)
    assert (ink.length, ink.tempo) == (free.length, free.tempo)
    assert "colours" in free.sentence() and "colours" not in ink.sentence()


@pytest.mark.parametrize(
    ("manner", "words"),
    [
        (replace(ORDINARY, loudness_db=45.0, pace_hz=7.0), "loudly and fast"),
        (replace(ORDINARY, loudness_db=10.0, pace_hz=2.5, pitch_range_st=1.0), "softly, slowly and in a flat tone"),
        (replace(ORDINARY, pitch_range_st=12.0), "in a lively tone"),
    ],
)
def test_manner_in_words(manner: Manner, words: str) -> None:
    assert in_words(manner) == words
    assert expression_of(Heard("a cat", manner), free_colours=True).sentence().startswith(f"Said {words}: ")
