"""A classifier of letters that are sculpted into clay.

It is a logistic regression on rendered letters. They are augmented to resemble sculptures: shifted,
rotated, blurred, of uneven depth, with traces of other letters and of single pushes. It is never trained on a
sculpture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression

from pentimento.goals3d.reliefs import letter_relief, place

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
_SIDE_PX = 28
"""Side of the pictures that are classified."""
_RENDERED_PX = 64
"""Side of the rendered training pictures."""
_SHARE = 0.8
"""Share of the side of the classified picture that the letter covers; the border of the area is cut off before."""


@dataclass(frozen=True)
class Classification:
    """The most probable letter of a height map."""

    letter: str
    probability: float


class LetterClassifier:
    """Classifies one letter that is sunk into clay."""

    def __init__(self, letters: str, examples: int, seed: int, fonts: Sequence[Path | None] = (None,)) -> None:
        """Train on ``examples`` augmented renderings of each letter in each font; None is the font of goals."""
        self.letters = letters
        pictures, labels = [], []
        for index, font in enumerate(fonts):
            reliefs = [letter_relief(letter, _RENDERED_PX, font) for letter in letters]
            for number in range(len(letters)):
                for example in range(index * examples, (index + 1) * examples):
                    rng = np.random.default_rng([seed, number, example])
                    pictures.append(_features(_augmented(number, reliefs, rng)))
                    labels.append(number)
        self._model = LogisticRegression(C=0.1, max_iter=200).fit(np.stack(pictures), labels)

    def classify(self, height_m: Array, border: float) -> Classification:
        """The most probable letter in heights [H, W], and its probability; the outer ``border`` (share of a side) is
        cut off."""
        rows, columns = (round(border * side) for side in height_m.shape)
        inner = height_m[rows : height_m.shape[0] - rows, columns : height_m.shape[1] - columns].astype(np.float64)
        shares = self._model.predict_proba(_features(inner)[None])[0]
        best = int(np.argmax(shares))
        return Classification(self.letters[int(self._model.classes_[best])], float(shares[best]))


def _augmented(number: int, reliefs: list[FloatArray], rng: np.random.Generator) -> FloatArray:
    """An augmented rendering [h, w] of a letter."""
    side = _RENDERED_PX
    relief = place(reliefs[number], (side, side), rng.uniform(_SHARE - 0.08, _SHARE + 0.12))
    turn = cv2.getRotationMatrix2D((side / 2, side / 2), rng.uniform(-5, 5), 1.0)
    turn[:, 2] = turn[:, 2] + rng.uniform(-2, 2, 2)
    relief = np.asarray(cv2.warpAffine(relief, turn, (side, side), borderMode=cv2.BORDER_REPLICATE))
    if rng.random() < 0.7:  # trace of another letter
        ghost = place(reliefs[int(rng.integers(len(reliefs)))], (side, side), _SHARE)
        relief = relief + rng.uniform(0.0, 0.5) * ghost
    for _ in range(int(rng.integers(0, 6))):  # extra or missing single pushes
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
    """Features [_SIDE_PX²]: the relief relative to its upper level, in units of its standard deviation."""
    small = np.asarray(cv2.resize(relief, (_SIDE_PX, _SIDE_PX), interpolation=cv2.INTER_AREA))
    small = small - np.percentile(small, 75)
    return np.clip(small / max(float(small.std()), 1e-9), -3.0, 1.0).ravel()


def classify_sculpture(
    classifier: LetterClassifier, height_m: Array, goal_m: Array, *, border: float
) -> dict[str, Any]:
    """Classification of the clay [H, W], and of the goal itself."""
    clay, goal = classifier.classify(height_m, border), classifier.classify(goal_m, border)
    return {"clay": clay.letter, "probability": clay.probability, "goal": goal.letter}
