"""The probability that a cause is at work, from its evidence: a logistic regression.

``decision.json`` holds its weights: one set for pushes, whose base model is further from most materials, fitted to all
worlds, and one for strokes and all other actions, fitted to worlds without pushes. ``python -m studies.decision`` fits
them on simulated worlds that serve no other purpose.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.evidence import Evidence

Array = NDArray[Any]

_LARGEST_Z = 3.0
"""Beyond it a sum over actions says nothing more: it grows with the size of the table."""
_LARGEST_SIGNATURE_Z = 8.0
"""The same of a fitted quantity."""
FEATURES = (
    "discovery_z", "confirmation_z", "log_share", "share_z", "votes", "form_z", "signature_z", "unnamed", "rival",
    "log_beside", "log_misfit",
)  # fmt: skip
AGAINST = ("form_z", "unnamed", "rival", "log_misfit")
"""Those that speak against a cause; the others speak for it."""


def features(evidence: Evidence) -> Array:
    """The evidence on bounded scales, [len(FEATURES)]."""

    def z(value: float, largest: float = _LARGEST_Z) -> float:
        return float(np.clip(value, -largest, largest))

    def log(value: float, smallest: float) -> float:
        return float(np.log(np.clip(value, smallest, 1.0)))

    return np.array([
        z(evidence.discovery_z), z(evidence.confirmation_z), log(evidence.share, 1e-4), z(evidence.share_z),
        evidence.votes, z(evidence.form_z), z(evidence.signature_z, _LARGEST_SIGNATURE_Z), min(evidence.unnamed, 2.0),
        min(evidence.rival, 2.0), log(evidence.beside, 1e-3), -log(1 / max(evidence.misfit, 1.0), 1e-2),
    ])  # fmt: skip


@dataclass(frozen=True)
class Decision:
    """Weights of the logistic regression."""

    intercept: float
    weights: Array
    """[len(FEATURES)]."""

    def probability(self, evidence: Evidence) -> float:
        """Probability that the cause is at work."""
        return float(1 / (1 + np.exp(-(self.intercept + self.weights @ features(evidence)))))


def default_decision(kind: str) -> Decision:
    """The decision that ships with the package, for a kind of actions (``Problem.kind``)."""
    sets = json.loads((resources.files("pentimento.diagnosis") / "decision.json").read_text(encoding="utf-8"))
    stored = sets.get(kind, sets["others"])
    return Decision(stored["intercept"], np.array([stored["weights"][name] for name in FEATURES]))
