"""A reader of sculpted letters: has the clay become what it was asked to be?

It is trained on rendered letters only, as the goals show them, made as rough as sculpting is: shifted, turned,
softened, of uneven depth, with traces of other letters and of single pushes. It never sees a sculpture.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression

from pentimento.goals3d.letters import letter_relief
from pentimento.goals3d.placing import place

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_SIDE_PX = 28
_DRAWN_PX = 64
_SHARE = 0.8
"""Of the picture that is read, the letter's; the reader is given the inner part of the area."""


@dataclass(frozen=True)
class Reading:
    """What a height map says."""

    letter: str
    probability: float


class LetterReader:
    """Reads one letter, sunk into clay."""

    def __init__(self, letters: str, examples: int, seed: int) -> None:
        """Train on so many renderings of each letter."""
        self.letters = letters
        reliefs = [letter_relief(letter, _DRAWN_PX) for letter in letters]
        pictures, labels = [], []
        for number in range(len(letters)):
            for example in range(examples):
                rng = np.random.default_rng([seed, number, example])
                pictures.append(_features(_roughened(number, reliefs, rng)))
                labels.append(number)
        self._model = LogisticRegression(C=0.1, max_iter=200).fit(np.stack(pictures), labels)

    def read(self, height_m: Array, border: float) -> Reading:
        """The likeliest letter in heights [H, W], and how likely it is; the outer ``border`` is not looked at."""
        rows, columns = (round(border * side) for side in height_m.shape)
        inner = height_m[rows : height_m.shape[0] - rows, columns : height_m.shape[1] - columns].astype(np.float64)
        shares = self._model.predict_proba(_features(inner)[None])[0]
        best = int(np.argmax(shares))
        return Reading(self.letters[int(self._model.classes_[best])], float(shares[best]))


def _roughened(number: int, reliefs: list[FloatArray], rng: np.random.Generator) -> FloatArray:
    """A rendering [h, w] as clay may show it."""
    side = _DRAWN_PX
    relief = place(reliefs[number], (side, side), rng.uniform(_SHARE - 0.08, _SHARE + 0.12))
    turn = cv2.getRotationMatrix2D((side / 2, side / 2), rng.uniform(-5, 5), 1.0)
    turn[:, 2] = turn[:, 2] + rng.uniform(-2, 2, 2)
    relief = np.asarray(cv2.warpAffine(relief, turn, (side, side), borderMode=cv2.BORDER_REPLICATE))
    if rng.random() < 0.7:  # what was there before
        ghost = place(reliefs[int(rng.integers(len(reliefs)))], (side, side), _SHARE)
        relief = relief + rng.uniform(0.0, 0.5) * ghost
    for _ in range(int(rng.integers(0, 6))):  # single pushes beside the letter, or missing ones in it
        start, heading = rng.uniform(0, side, 2), rng.uniform(-np.pi, np.pi)
        end = start + rng.uniform(3, 14) * np.array([np.cos(heading), np.sin(heading)])
        mark = np.zeros((side, side))
        cv2.line(mark, [int(v) for v in start], [int(v) for v in end], 1.0, int(rng.integers(3, 7)))
        relief = np.asarray(relief + rng.uniform(-0.5, 0.4) * mark)
    uneven = np.asarray(cv2.GaussianBlur(rng.normal(0, 1, (side, side)), (0, 0), 4.0))
    relief = relief * (1 + 0.25 * uneven / uneven.std())
    noise = np.asarray(cv2.GaussianBlur(rng.normal(0, 1, (side, side)), (0, 0), 1.5))
    relief = relief + rng.uniform(0, 0.15) * noise / noise.std()
    return np.asarray(cv2.GaussianBlur(relief, (0, 0), rng.uniform(0.8, 2.5)))


def _features(relief: FloatArray) -> FloatArray:
    """What is read [_SIDE_PX²]: the relief about its upper level, in units of its own spread."""
    small = np.asarray(cv2.resize(relief, (_SIDE_PX, _SIDE_PX), interpolation=cv2.INTER_AREA))
    small = small - np.percentile(small, 75)
    return np.clip(small / max(float(small.std()), 1e-9), -3.0, 1.0).ravel()
