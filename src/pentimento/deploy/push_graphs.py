"""A push model as graphs: height maps after alternative pushes, and the gradients of one push."""

from __future__ import annotations

from typing import Final

import torch
from torch import Tensor

from pentimento.bundle.manifest import ClayFacts
from pentimento.deploy.graphs import Graph, compared, export, generator
from pentimento.dynamics.pushes.push_model import PushFacts, TorchClay

_EXAMPLE_ACTIONS: Final = 7  # differs from every other size, so that the exporter does not confuse them
_COMPARED_WITH: Final = (1, 2, 12)  # numbers of pushes
_UNITS: Final = {
    "height_m": "m above the table, without holes; row 0 is the top",
    "actions": "m, m, rad, m, m, canvas frame",
    "action": "m, m, rad, m, m, canvas frame",
    "after_m": "m above the table",
    "of_after": "d loss / d after_m",
    "to_height": "d loss / d height_m",
    "to_action": "d loss / d action",
}


def clay_graphs(
    name: str,
    clay: TorchClay,
    facts: PushFacts,
    *,
    shape: tuple[int, int],
    tolerance: float,
    models: tuple[str, ...],
) -> tuple[ClayFacts, dict[str, Graph]]:
    """Facts and graphs by which the lean core plans pushes, for height maps [H, W] of this shape over the window.

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
    graphs = {
        key: compared(
            key, exported, function, examples=[arguments(count) for count in _COMPARED_WITH], units=_UNITS,
            tolerance=tolerance, models=models,
        )
        for key, exported, function, arguments in (
            (f"{name}_after", forward, after, examples),
            (f"{name}_pull", backward, pull, pull_examples),
        )
    }  # fmt: skip
    x_min, y_min, x_max, y_max = (float(edge) for edge in clay.window_m)
    window = (x_min, y_min, x_max, y_max)
    return ClayFacts(clay.end_effector, facts.kind, window, shape, facts.longest_m, facts.deepest_m), graphs
