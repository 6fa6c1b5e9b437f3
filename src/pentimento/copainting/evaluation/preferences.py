"""What people preferred: answers of the blind page, joined with its key, and an exact binomial test."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from pentimento.contracts.errors import ContractError

CHOICES = ("left", "right", "both", "neither")


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
        strange = [name for name, choice in answers.items() if name not in key or choice not in CHOICES]
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
