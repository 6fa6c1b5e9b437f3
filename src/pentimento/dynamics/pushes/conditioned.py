"""One model for several materials and end-effectors, and what an unseen one needs of it: a few pushes.

Each pair of material and end-effector is a context of the network (``param2deform``): five numbers of the tool and a
vector beside length and depth. All else is shared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.posed_samples import PoseSamples
from pentimento.dynamics.pushes.push_model import PushModel
from pentimento.dynamics.pushes.training import loss

_STEPS, _RATE, _RATE_OF_ALL = 150, 0.01, 3e-4
_AT_ONCE = 20
_OF_A_CONTEXT = ("tool", "context", "apart")
"""Parameters of the network with a row for each context."""


def together(parts: Sequence[PoseSamples]) -> PoseSamples:
    """Pushes of several contexts as one set; the k-th part is of context k."""
    columns = list(zip(*parts, strict=True))
    contexts = torch.cat([torch.full_like(part.context, number) for number, part in enumerate(parts)])
    state, change, known, length, depth = (torch.cat(column) for column in columns[:5])
    return PoseSamples(state, change, known, length, depth, contexts)


def adapted(model: PushModel, few: PoseSamples, context: tuple[str, str], visual_weight: float, seed: int) -> PushModel:
    """A model of one unseen context, from a few pushes in it.

    It starts from the trained context that foretells them best; then the context's numbers and the last layer are
    fitted, and at last everything, slowly: a material that gives way otherwise is more than another context.

    Raises:
        ContractError: no push.
    """
    if not len(few.state):
        raise ContractError("There are no pushes to adapt to; record some in the new material.")
    pixels_per_m = model.facts.crop.pixels_per_m
    facts = replace(
        model.facts,
        contexts=(context,),
        longest_m=float(few.length_m.max()),
        deepest_m=float(few.depth_m.max()),
    )
    made = PushModel(facts)
    generator = torch.Generator().manual_seed(seed)
    for old, new in zip(model.members, made.members, strict=True):
        assert isinstance(old, Param2Deform) and isinstance(new, Param2Deform)
        weights = old.state_dict()
        best = _nearest(old, few, pixels_per_m, visual_weight)
        own = {name: weights[name][best : best + 1] for name in _OF_A_CONTEXT if name in weights}
        new.load_state_dict(weights | own)
        _fit_context(new, few, pixels_per_m, visual_weight, generator)
    return made.eval().requires_grad_(False)


def _nearest(network: Param2Deform, few: PoseSamples, pixels_per_m: float, visual_weight: float) -> int:
    """The trained context that foretells the pushes best."""
    errors = []
    with torch.no_grad():
        for number in range(len(network.tool)):
            change = network(few.state, few.length_m, few.depth_m, torch.full_like(few.context, number))
            errors.append(float(loss(change - few.change, few.known, pixels_per_m, visual_weight)))
    return errors.index(min(errors))


def _fit_context(
    network: Param2Deform, few: PoseSamples, pixels_per_m: float, visual_weight: float, generator: torch.Generator
) -> None:
    few = few._replace(context=torch.zeros_like(few.context))
    own = [value for name, value in network.named_parameters() if name in _OF_A_CONTEXT]
    last = list(network.merged[-1].parameters())
    steps: list[list[dict[str, Any]]] = [
        [{"params": own, "lr": _RATE}, {"params": last, "lr": _RATE / 5}],
        [{"params": list(network.parameters()), "lr": _RATE_OF_ALL}],
    ]
    for groups in steps:
        network.requires_grad_(False)
        for group in groups:
            for parameter in group["params"]:
                parameter.requires_grad_(True)
        optimizer = torch.optim.Adam(groups)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, _STEPS)
        for _ in range(_STEPS):
            some = few.pick(torch.randperm(len(few.state), generator=generator)[:_AT_ONCE])
            some = some.mirrored(torch.rand(len(some.state), generator=generator) < 0.5)
            optimizer.zero_grad()
            change = network(some.state, some.length_m, some.depth_m, some.context)
            torch.autograd.backward(loss(change - some.change, some.known, pixels_per_m, visual_weight))
            optimizer.step()
            schedule.step()
