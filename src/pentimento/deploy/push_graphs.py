"""A push model as graphs: height maps after alternative pushes, and the gradients of one push; and the check of what
was deployed, correction included, against the model that was diagnosed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import torch
from torch import Tensor

from pentimento.bundle.manifest import ClayFacts
from pentimento.deploy.graphs import Graph, compared, export, generator
from pentimento.dynamics.pushes.push_model import PushFacts, TorchClay
from pentimento.planning.pushes.memory import PushMemory
from pentimento.planning.pushes.rollout import PushModel as Model

_EXAMPLE_ACTIONS: Final = 7  # differs from every other size, so that the exporter does not confuse them
_COMPARED_WITH: Final = (1, 2, 12)  # numbers of pushes
_EXAMPLES: Final = 4
"""Pushes that a deployed model is compared by."""
_LEVEL_M: Final = 0.04
_UNITS: Final = {
    "height_m": "m above the table, without holes; row 0 is the top",
    "actions": "m, m, rad, m, m, canvas frame",
    "action": "m, m, rad, m, m, canvas frame",
    "after_m": "m above the table",
    "of_after": "d loss / d after_m",
    "to_height": "d loss / d height_m",
    "to_action": "d loss / d action",
}


def clay_facts(
    members: Sequence[TorchClay], facts: PushFacts, shape: tuple[int, int], correction: str | None
) -> ClayFacts:
    """Facts of an ensemble, for height maps [H, W] of this shape over its window."""
    x_min, y_min, x_max, y_max = (float(edge) for edge in members[0].window_m)
    return ClayFacts(
        members[0].end_effector, facts.kind, (x_min, y_min, x_max, y_max), shape, facts.longest_m, facts.deepest_m,
        len(members), correction, unexplained=facts.unexplained,
    )  # fmt: skip


def clay_graphs(
    name: str,
    clay: TorchClay,
    facts: PushFacts,
    *,
    shape: tuple[int, int],
    tolerance: float,
    models: tuple[str, ...],
) -> dict[str, Graph]:
    """Graphs by which the lean core plans pushes, for height maps [H, W] of this shape over the window.

    Raises:
        ParityError: a graph does not compute what PyTorch does.
    """

    def after(height: Tensor, actions: Tensor) -> tuple[Tensor]:
        return (clay.heights(height.expand(actions.shape[0], -1, -1), actions),)

    def pull(height: Tensor, action: Tensor, cotangent: Tensor) -> tuple[Tensor, ...]:
        leaves = [argument.detach().requires_grad_(True) for argument in (height, action)]
        with torch.enable_grad():
            deformed = clay.heights(leaves[0][None], leaves[1][None])[0]
        return torch.autograd.grad(deformed, leaves, cotangent)

    def examples(count: int) -> list[Tensor]:
        numbers = generator(name, count)
        rough = 0.04 + 2e-3 * torch.nn.functional.avg_pool2d(torch.randn(1, *shape, generator=numbers), 5, 1, 2)[0]
        low, high = torch.tensor(clay.window_m, dtype=torch.float32).view(2, 2)
        unit = torch.rand(count, 5, generator=numbers)
        place, turn = low + (high - low) * unit[:, :2], torch.pi * (2 * unit[:, 2:3] - 1)
        reach = unit[:, 3:] * torch.tensor([facts.longest_m, facts.deepest_m])
        return [rough, torch.cat([place, turn, reach], dim=1)]

    def pull_examples(count: int) -> list[Tensor]:
        height, actions = examples(count)
        return [height, actions[0], torch.randn(shape, generator=generator(name, count + 1))]

    forward = export(
        after, examples(_EXAMPLE_ACTIONS), ["height_m", "actions"], outputs=["after_m"], free=[{}, {0: "pushes"}]
    )
    backward = export(pull, pull_examples(1), ["height_m", "action", "of_after"], outputs=["to_height", "to_action"])
    return {
        key: compared(
            key, exported, function, examples=[arguments(count) for count in _COMPARED_WITH], units=_UNITS,
            tolerance=tolerance, models=models,
        )
        for key, exported, function, arguments in (
            (f"{name}_after", forward, after, examples),
            (f"{name}_pull", backward, pull, pull_examples),
        )
    }  # fmt: skip


def deployed_difference(
    deployed: Sequence[Model], diagnosed: Sequence[Model], facts: ClayFacts, covariates: Mapping[str, tuple[float, ...]]
) -> float:
    """Maximum relative difference of deployed push models from the diagnosed ones, over their members: of the change of
    height that they predict, and of the gradients. Each is the norm of the difference over the norm.

    Args:
        covariates: by name, values of which the examples' memories take one each.
    """
    low, high = np.array(facts.window_m).reshape(2, 2)
    worst = 0.0
    for number in range(_EXAMPLES):
        rng = np.random.default_rng([number])
        unit = rng.random((_EXAMPLE_ACTIONS, 5))
        actions = np.concatenate([low + (high - low) * (0.25 + unit[:, :2] / 2), unit[:, 2:]], axis=1)
        actions[:, 2:] *= [2 * np.pi, facts.longest_m, facts.deepest_m]
        memory = PushMemory(
            tuple(actions[1:]), {name: float(rng.choice(values)) for name, values in covariates.items()}
        )
        height = (_LEVEL_M + 1e-3 * rng.standard_normal(facts.shape)).astype(np.float32)
        cotangent = rng.standard_normal(facts.shape).astype(np.float32)
        for one, other in zip(deployed, diagnosed, strict=True):
            (after, pull), (expected, expected_pull) = (m.step(height, actions[0], memory) for m in (one, other))
            found, known = (after - height, *pull(cotangent)), (expected - height, *expected_pull(cotangent))
            for a, b in zip(map(np.asarray, found), map(np.asarray, known), strict=True):
                worst = max(worst, float(np.linalg.norm(a - b) / np.linalg.norm(b)))
    return worst
