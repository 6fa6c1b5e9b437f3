"""How often causes are at work, by their stated probability."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from sklearn.metrics import brier_score_loss

from studies.blind.binomial import interval

Line = dict[str, Any]

_BINS = 10
_READ_AS = {"established": 0.95, "suspected": 0.5}
"""Probabilities as which the two words alone would be read."""


class Stated(NamedTuple):
    """One named cause."""

    probability: float
    status: str
    true: bool


def stated(lines: Sequence[Line]) -> list[Stated]:
    """Every established or suspected cause of all worlds with a verdict."""
    return [
        Stated(entry["probability"], status, entry["cause"] in line["truth"]["causes"])
        for line in lines
        if "verdict" in line
        for status in ("established", "suspected")
        for entry in line["verdict"][status]
    ]


def calibration(lines: Sequence[Line]) -> str:
    """Markdown: the bins that hold causes, the expected calibration error and the Brier scores."""
    found = stated(lines)
    if not found:
        return "No cause is named."
    probability, true = np.array([one.probability for one in found]), np.array([one.true for one in found])
    bins = np.minimum((probability * _BINS).astype(int), _BINS - 1)
    table = ["| probability | causes | mean probability | fraction active | 95 % |", "|---|---|---|---|---|"]
    error = 0.0
    for number in np.unique(bins):
        own = bins == number
        hits, of = int(true[own].sum()), int(own.sum())
        low, high = interval(hits, of)
        error += of / len(found) * abs(float(probability[own].mean()) - hits / of)
        limits = f"{number / _BINS:.1f} – {(number + 1) / _BINS:.1f}"
        table.append(f"| {limits} | {of} | {probability[own].mean():.3f} | {hits / of:.3f} | {low:.2f} – {high:.2f} |")
    read = np.array([_READ_AS[one.status] for one in found])
    scores = f"Expected calibration error {error:.3f}; Brier score {brier_score_loss(true, probability):.3f}, "
    scores += f"{brier_score_loss(true, read):.3f} with established read as .95 and suspected as .5."
    return "\n".join([*table, "", scores])
