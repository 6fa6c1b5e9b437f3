"""A blind page for pairwise preferences, the answers that people saved, and an exact binomial test (thesis 6.5.3).

The page is one HTML file that needs no network. Which method drew which picture is in a separate key (Figure 6.6).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import encode_png
from pentimento.report.templates import render

Picture = NDArray[np.uint8]

_SHOWN_PX: Final = 256
_CHOICES: Final = {
    "left": "the left fits better",
    "right": "the right fits better",
    "both": "both fit",
    "neither": "neither",
}


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two drawings for one text."""

    caption: str
    ours: Picture
    """uint8 [H, W, 3]."""
    other: Picture
    rival: str
    """The method of `other`."""


def preference_page(comparisons: Sequence[Comparison], seed: int) -> tuple[str, dict[str, dict[str, str]]]:
    """The page, and its key {id: {left, right}} with `ours` on one side and the rival's name on the other.

    Order, sides and ids are drawn by the seed, so ids reveal neither.
    """
    generator = np.random.default_rng([seed, 7])
    shown: list[dict[str, object]] = []
    key: dict[str, dict[str, str]] = {}
    for index in generator.permutation(len(comparisons)):
        one = comparisons[index]
        sides = [("ours", one.ours), (one.rival, one.other)]
        if generator.random() < 0.5:
            sides.reverse()
        name = hashlib.sha256(f"{seed} {index}".encode()).hexdigest()[:12]
        key[name] = {"left": sides[0][0], "right": sides[1][0]}
        shown.append({"id": name, "caption": one.caption, "left": _png(sides[0][1]), "right": _png(sides[1][1])})
    return render("preference.html", questions=shown, choices=_CHOICES), key


def _png(picture: Picture) -> bytes:
    large = cv2.resize(picture, (_SHOWN_PX, _SHOWN_PX), interpolation=cv2.INTER_NEAREST)
    return encode_png(np.asarray(large, dtype=np.uint8))


@dataclass(frozen=True)
class Preference:
    """Our drawings compared with one rival's."""

    answers: dict[str, int]
    """Number of choices of `ours`, `rival`, `both` and `neither`, over all people."""
    people: int
    pairs_ours: int
    """Pairs of which more people preferred ours."""
    pairs_rival: int
    """Pairs of which more people preferred the rival's."""
    share: float | None
    """Fraction of `pairs_ours` in the decided pairs; None if no pair is decided."""
    interval: tuple[float, float] | None
    """Its 95 % interval (Clopper and Pearson 1934)."""
    p: float | None
    """Two-sided exact p of a fraction of one half."""


def read_answers(paths: Sequence[Path], key: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, str]]:
    """{participant: {id: choice}} of the files that people saved.

    Raises:
        ContractError: a file is not JSON of that form, names pairs that are not in the key, or a participant twice.
    """
    found: dict[str, dict[str, str]] = {}
    for path in paths:
        try:
            saved = json.loads(path.read_text(encoding="utf-8"))
            person, answers = str(saved["participant"]), dict(saved["answers"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ContractError(f"{path} is not a file of answers ({error}); save it from the page again.") from error
        unknown = [name for name, choice in answers.items() if name not in key or choice not in _CHOICES]
        if unknown:
            raise ContractError(
                f"{path} answers {unknown[0]!r}, which is not in the key or not a choice; is the file of this page?"
            )
        if person in found:
            raise ContractError(f"{path} is a second file of {person!r}; give one file for each person.")
        found[person] = answers
    return found


def preferences(
    answers: Mapping[str, Mapping[str, str]], key: Mapping[str, Mapping[str, str]]
) -> dict[str, Preference]:
    """Results by rival. Each pair counts once, by the majority of its people, because answers to one pair are not
    independent.
    """
    rivals = sorted({side for sides in key.values() for side in sides.values()} - {"ours"})
    return {rival: _against(rival, answers, key) for rival in rivals}


def _against(rival: str, answers: Mapping[str, Mapping[str, str]], key: Mapping[str, Mapping[str, str]]) -> Preference:
    pairs = {name: sides for name, sides in key.items() if rival in sides.values()}
    counts = dict.fromkeys(("ours", "rival", "both", "neither"), 0)
    ahead = dict.fromkeys(pairs, 0)
    people: set[Any] = set()
    for person, chosen in answers.items():
        for name, choice in chosen.items():
            if name not in pairs:
                continue
            people.add(person)
            method = pairs[name].get(choice, choice)
            counts["rival" if method == rival else method] += 1
            ahead[name] += (method == "ours") - (method == rival)
    ours, theirs = sum(lead > 0 for lead in ahead.values()), sum(lead < 0 for lead in ahead.values())
    if ours + theirs == 0:
        return Preference(counts, len(people), 0, 0, None, None, None)
    test = binomtest(ours, ours + theirs)
    bounds = test.proportion_ci(0.95, method="exact")
    interval = float(bounds.low), float(bounds.high)
    return Preference(counts, len(people), ours, theirs, ours / (ours + theirs), interval, float(test.pvalue))
