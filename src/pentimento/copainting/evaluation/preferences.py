"""A blind page for pairwise preferences, the answers that people saved, and an exact binomial test (thesis 6.5.3)."""

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
    """Uint8 [H, W, 3]."""
    other: Picture
    rival: str
    """Whose the other is."""


def preference_page(comparisons: Sequence[Comparison], seed: int) -> tuple[str, dict[str, dict[str, str]]]:
    """The page, and its key {id: {left, right}} with `ours` on one side and the rival's name on the other.

    Order and sides are drawn by the seed; ids say nothing of either.
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
    """Our drawings against one rival's."""

    answers: dict[str, int]
    """How often `ours`, `rival`, `both` and `neither` were chosen, over all people."""
    people: int
    pairs_ours: int
    """Pairs of which more people preferred ours than the rival's."""
    pairs_rival: int
    share: float | None
    """Of the decided pairs, those that are ours; None where none is decided."""
    interval: tuple[float, float] | None
    """95 % of that share (Clopper and Pearson 1934)."""
    p: float | None
    """Of the share being one half: exact, two-sided."""


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
            raise ContractError(f"{path} holds no saved answers ({error}); save them from the page again.") from error
        strange = [name for name, choice in answers.items() if name not in key or choice not in _CHOICES]
        if strange:
            raise ContractError(
                f"{path} answers {strange[0]!r} in a way that the key does not know; is it of this page?"
            )
        if person in found:
            raise ContractError(f"{path} is of {person!r}, whose answers are here already; each person answers once.")
        found[person] = answers
    return found


def preferences(
    answers: Mapping[str, Mapping[str, str]], key: Mapping[str, Mapping[str, str]]
) -> dict[str, Preference]:
    """By rival. A pair counts once in the test, by the majority of its people, who are not independent."""
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
            meant = pairs[name].get(choice, choice)
            counts["rival" if meant == rival else meant] += 1
            ahead[name] += (meant == "ours") - (meant == rival)
    ours, theirs = sum(lead > 0 for lead in ahead.values()), sum(lead < 0 for lead in ahead.values())
    if ours + theirs == 0:
        return Preference(counts, len(people), 0, 0, None, None, None)
    test = binomtest(ours, ours + theirs)
    sure = test.proportion_ci(0.95, method="exact")
    interval = float(sure.low), float(sure.high)
    return Preference(counts, len(people), ours, theirs, ours / (ours + theirs), interval, float(test.pvalue))
