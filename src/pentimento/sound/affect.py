"""From the way in which something is said to valence and arousal, and from these to a way of painting (thesis 6.7).

Arousal rises with loudness, pitch range and pace (Juslin and Laukka 2003, "Communication of emotions in vocal
expression and music performance: different channels, same code?"). Valence is hardly heard: from twenty such cues,
listeners' ratings of activation could be predicted, those of valence could not (Laukka, Juslin and Bresin 2005, "A
dimensional approach to vocal expression of emotion"). It is therefore small here: a wide pitch range sounds pleasant
(Scherer and Oshinsky 1977, "Cue utilization in emotion attribution from auditory stimuli").

The colours are those that evoke such an emotion. In standard deviations, pleasure is .69 B + .22 S, and arousal
-.31 B + .60 S, of brightness B and saturation S (Valdez and Mehrabian 1994, "Effects of color on emotions"); this is
solved for B and S. Movements are larger and faster with activation (Wallbott 1998, "Bodily expression of emotion"):
so are strokes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pentimento.control.expression import PLAIN, Expression
from pentimento.sound.manner import Manner, manner_of
from pentimento.sound.recording import Recording

_LOUDNESS_DB: Final = ((6.0, 18.0), (38.0, 50.0))
"""Of softly (wholly, hardly) and loudly (hardly, wholly) said wishes: between them lie normal voices in quiet and loud
rooms. A step of vocal effort is 6 dB (ISO 9921:2003)."""
_RANGE_ST: Final = ((1.2, 2.4), (6.5, 13.0))
"""The same of the pitch's range: of standard deviations of 1 to 2.5 semitones."""
_PACE_HZ: Final = ((2.55, 3.4), (5.4, 7.2))
"""The same of syllables in a second."""
_CUES_FOR_ALL: Final = 2.0
"""Cues, of three, that say the same when arousal is 1."""
_MAX_VALENCE: Final = 0.3

_PLEASURE_AROUSAL: Final = np.array([[0.69, 0.22], [-0.31, 0.60]])
"""Of brightness and saturation (Valdez and Mehrabian 1994)."""
_LIGHTNESS: Final = 12.0
"""L* for a standard deviation of brightness."""
_CHROMA: Final = 1.32
"""Factor for a standard deviation of saturation."""
_LENGTH: Final = 1.5
"""Factor of stroke lengths at arousal 1, and its inverse at -1."""
_TEMPO: Final = 1.3
"""The same of the tool's speed."""


@dataclass(frozen=True)
class Affect:
    """An emotion, as a place in the circumplex (Russell 1980)."""

    valence: float
    """-1 (unpleasant) to 1 (pleasant)."""
    arousal: float
    """-1 (calm) to 1 (excited)."""


@dataclass(frozen=True)
class Heard:
    """A wish in a recording."""

    words: str
    manner: Manner | None = None
    """None for a sound that is no speech."""


Listener = Callable[[Recording], Heard]
"""From a recording to the wish in it; raises SoundError where there is none."""


def spoken(words_of: Callable[[Recording], str]) -> Listener:
    """What hears words, and how they are said."""

    def heard(recording: Recording) -> Heard:
        words = words_of(recording)
        return Heard(words, manner_of(recording, words))

    return heard


def affect_of(manner: Manner) -> Affect:
    """Of how something is said; 0 for an ordinary statement, and for what could not be measured."""
    cues = _cues(manner)
    return Affect(valence=_MAX_VALENCE * cues["pitch"], arousal=max(-1.0, min(1.0, sum(cues.values()) / _CUES_FOR_ALL)))


def expression_of(heard: Heard, *, free_colours: bool) -> Expression:
    """How a wish is painted that was said like this.

    Args:
        free_colours: whether the planner chooses the paints; otherwise colours stay as they are.
    """
    if heard.manner is None:
        return PLAIN
    expression = expression_of_affect(affect_of(heard.manner))
    if not free_colours:
        expression = replace(expression, chroma=1.0, lightness=0.0)
    return replace(expression, said=in_words(heard.manner))


def expression_of_affect(affect: Affect) -> Expression:
    """Colours that evoke the emotion, and movements as large and as fast as it."""
    brightness, saturation = np.linalg.solve(_PLEASURE_AROUSAL, [affect.valence, affect.arousal])
    return Expression(
        "", chroma=float(_CHROMA**saturation), lightness=_LIGHTNESS * float(brightness),
        length=_LENGTH**affect.arousal, tempo=_TEMPO**affect.arousal,
    )  # fmt: skip


def in_words(manner: Manner) -> str:
    """How something was said, such as "loudly and fast"; "" for an ordinary way."""
    cues = _cues(manner)
    words = {
        "loudness": ("softly", "loudly"), "pace": ("slowly", "fast"), "pitch": ("in a flat tone", "in a lively tone"),
    }  # fmt: skip
    found = [words[name][cues[name] > 0] for name in words if cues[name] != 0]
    return " and ".join([", ".join(found[:-1]), found[-1]]) if len(found) > 1 else "".join(found)


def _cues(manner: Manner) -> dict[str, float]:
    """-1 to 1 each."""
    return {
        "loudness": _cue(manner.loudness_db, _LOUDNESS_DB),
        "pitch": _cue(_log(manner.pitch_range_st), _logs(_RANGE_ST)),
        "pace": _cue(_log(manner.pace_hz), _logs(_PACE_HZ)),
    }


def _cue(value: float, ends: tuple[tuple[float, float], tuple[float, float]]) -> float:
    """0 in the ordinary range, and linear beyond it to -1 and 1; 0 for NaN."""
    (lowest, low), (high, highest) = ends
    if value < low:
        return max(-1.0, (value - low) / (low - lowest))
    if value > high:
        return min(1.0, (value - high) / (highest - high))
    return 0.0


def _log(value: float) -> float:
    return math.log(value) if value > 0 else math.nan


def _logs(ends: tuple[tuple[float, float], tuple[float, float]]) -> tuple[tuple[float, float], tuple[float, float]]:
    (lowest, low), (high, highest) = ends
    return (_log(lowest), _log(low)), (_log(high), _log(highest))
