"""All numbers by which the engine decides."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DecisionRule:
    """Limits of the search and of the decision. None depends on the kind of actions."""

    most_causes: int = 6
    """Causes in one model."""
    entry_p: float = 0.05
    """Adjusted p of a score test, and p of the error that a refit removes, below which the search takes a cause."""
    near_best: float = 0.4
    """Share of the best candidate's held-out gain from which another one is refitted, too."""
    refits: int = 2
    """Refitted candidates of one round, and as many of the best one's family."""
    rivals: int = 1
    """Refitted rivals of each cause, and as many of its family."""
    as_good_as: float = 0.95
    """Share of what the best candidate removes from which a simpler one counts as equal."""
    worse_p: float = 0.05
    """Paired p below which a model is worse than another."""
    large_share: float = 0.1
    """Share of the error above the floor that a cause must remove before the residual is learned."""
    small_share: float = 0.01
    """The same afterwards."""
    established: float = 0.95
    """Probability from which a cause is established."""
    suspected: float = 0.5
    """Probability from which a cause is suspected."""


DEFAULT_RULE = DecisionRule()
