"""The graphs of a push model equal PyTorch."""

from typing import Any

import numpy as np
import pytest
import torch

from pentimento.bundle.graphs import GraphClay
from pentimento.bundle.manifest import ClayFacts
from pentimento.contracts.errors import ContractError
from pentimento.deploy.graphs import Graph, session
from pentimento.deploy.push_graphs import clay_facts, clay_graphs
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop
from pentimento.dynamics.pushes.push_model import PushFacts, PushModel, TorchClay, planned_clay
from pentimento.planning.pushes.rollout import PushModel as Seam

FACTS = PushFacts("push", (("foam", "ball"),), Crop(24, 500.0, 0.014), 4, 0.02, 0.008, 1)
WINDOW = np.array([0.0, 0.0, 0.1, 0.08])
SHAPE = (40, 50)
ACTION = np.array([0.05, 0.04, 0.7, 0.015, 0.006])


@pytest.fixture(scope="module")
def clay() -> TorchClay:
    torch.manual_seed(0)
    model = PushModel(FACTS)
    for member in model.members:
        assert isinstance(member, Param2Deform)
        for parameter in member.merged[-1].parameters():
            torch.nn.init.normal_(parameter, std=0.05)
        member.tool.data[:, 4] = 0.8
    return planned_clay(model.eval().requires_grad_(False), WINDOW)


@pytest.fixture(scope="module")
def exported(clay: TorchClay) -> tuple[ClayFacts, dict[str, Graph]]:
    return clay_facts([clay], FACTS, SHAPE, None), clay_graphs(
        "clay", clay, FACTS, shape=SHAPE, tolerance=1e-4, models=("push_foam",)
    )


@pytest.fixture(scope="module")
def by_graphs(exported: tuple[ClayFacts, dict[str, Graph]]) -> GraphClay:
    facts, graphs = exported
    opened = {name: session(graph.content, {}) for name, graph in graphs.items()}

    def ask(name: str, *arguments: Any) -> list[Any]:
        given = {port.name: array for port, array in zip(graphs[name].inputs, arguments, strict=True)}
        return list(opened[name].run(None, given))

    return GraphClay(ask, "clay", facts)


def height() -> np.ndarray:
    return (0.04 + 5e-4 * np.random.default_rng(0).standard_normal(SHAPE)).astype(np.float32)


def test_push_graphs_equal_pytorch_in_values_and_gradients(clay: TorchClay, by_graphs: GraphClay) -> None:
    one: Seam = clay
    other: Seam = by_graphs
    actions = np.stack([ACTION, ACTION + np.array([0.02, -0.01, 2.0, -0.01, 0.0]), ACTION * 0.5])
    np.testing.assert_allclose(other.after(height(), actions), one.after(height(), actions), atol=1e-7)
    cotangent = np.cos(np.arange(40) / 6)[:, None] * np.ones(50, dtype=np.float32)
    result, pull = one.step(height(), ACTION)
    graph_result, pull_too = other.step(height(), ACTION)
    np.testing.assert_allclose(graph_result, result, atol=1e-7)
    assert np.abs(result - height()).max() > 1e-3
    (to_height, to_action), (to_height_too, to_action_too) = pull(cotangent), pull_too(cotangent)
    np.testing.assert_allclose(to_height_too, to_height, atol=1e-5)
    np.testing.assert_allclose(to_action_too, to_action, rtol=1e-3, atol=1e-4 * np.abs(to_action).max())
    assert other.end_effector == "ball"
    np.testing.assert_array_equal(other.window_m, WINDOW)


def test_push_graph_takes_any_number_of_pushes(by_graphs: GraphClay) -> None:
    assert by_graphs.after(height(), np.empty((0, 5))).shape == (0, *SHAPE)
    assert by_graphs.after(height(), np.tile(ACTION, (5, 1))).shape == (5, *SHAPE)


def test_push_graph_rejects_scan_of_another_size(by_graphs: GraphClay) -> None:
    with pytest.raises(ContractError, match=r"is \[20, 50\] .* for \[40, 50\]"):
        by_graphs.after(height()[:20], ACTION[None])


def test_push_graph_rejects_scan_with_holes(by_graphs: GraphClay) -> None:
    holed = height()
    holed[3, 4] = np.nan
    with pytest.raises(ContractError, match="holes"):
        by_graphs.step(holed, ACTION)


def test_push_graphs_have_facts_and_parity(exported: tuple[ClayFacts, dict[str, Graph]]) -> None:
    facts, graphs = exported
    assert facts == ClayFacts("ball", "push", (0.0, 0.0, 0.1, 0.08), SHAPE, 0.02, 0.008, 1, None)
    assert graphs["clay_after"].inputs[1].shape == ("pushes", 5)
    assert max(max(graph.parity.values()) for graph in graphs.values()) < 1e-4
    assert all(graph.models == ("push_foam",) for graph in graphs.values())
