"""A bundle's push models as the planner uses them: networks with the correction that the diagnosis has established."""

from __future__ import annotations

from pentimento.bundle.graphs import GraphClay, Graphs
from pentimento.planning.pushes.analytic.correction import CorrectedClay
from pentimento.planning.pushes.rollout import PushModel


def clay_members(graphs: Graphs, name: str) -> tuple[PushModel, ...]:
    """The ensemble of one of the manifest's push models."""
    facts, correction = graphs.bundle.manifest.clays[name], graphs.bundle.corrections.get(name)
    members = [GraphClay(graphs, f"{name}_{member}", facts) for member in range(facts.members)]
    return tuple(member if correction is None else CorrectedClay(member, correction) for member in members)
