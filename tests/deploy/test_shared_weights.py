"""Graphs that share a file of tensors compute what they compute with files of their own, and equal tensors lie once."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pentimento.bundle.graphs import Graphs
from pentimento.bundle.onnx_header import read_header
from pentimento.bundle.reader import open_bundle
from pentimento.bundle.views import random_views, resizing_matrix
from pentimento.deploy import graphs as graph_module
from pentimento.deploy.bundle import graph_files
from pentimento.deploy.graphs import Graph
from pentimento.deploy.objective_graphs import encoder_graphs
from pentimento.deploy.shared_weights import share_weights
from tests.bundle.tiny_bundle import write_tiny_bundle
from tests.copainting.goal_planners import ENCODER, small_encoder
from tests.deploy.bundles import put_graphs

VIEWS, MIN_BYTES = 1, 4096


@pytest.fixture(scope="module")
def alone() -> dict[str, Graph]:
    """The encoder's graphs, each with its tensors in a file of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(graph_module, "INLINE_BYTES", MIN_BYTES)
        return encoder_graphs(small_encoder(), VIEWS, 1e-4)


@pytest.fixture(scope="module")
def shared(alone: dict[str, Graph]) -> dict[str, Graph]:
    return share_weights(alone, MIN_BYTES)


def places(graph: Graph) -> set[tuple[int, int]]:
    return {(tensor.offset, tensor.length) for tensor in read_header(graph.content).external}


def test_tensors_of_both_graphs_lie_once_and_those_of_others_apart(
    alone: dict[str, Graph], shared: dict[str, Graph]
) -> None:
    assert [*shared] == [*alone] == ["semantic", "text", "caption"]
    assert shared["caption"] is alone["caption"] and shared["caption"].weights is not None  # nothing in common
    semantic, text = shared["semantic"], shared["text"]
    assert semantic.weights is text.weights is not None and semantic.weights.file == "semantic.weights"
    assert set(graph_files(shared)) == set(graph_files(alone)) - {"graphs/text.weights"}
    in_common = sum(length for _, length in places(semantic) & places(text))
    stored = len(semantic.weights.content)
    before = sum(len(graph.weights.content) for graph in (alone["semantic"], alone["text"]) if graph.weights)
    assert in_common > MIN_BYTES
    assert before - stored == pytest.approx(in_common, abs=64 * len(places(semantic)))  # but for the gaps


def test_a_bundle_with_shared_weights_computes_the_same(
    alone: dict[str, Graph], shared: dict[str, Graph], tmp_path: Path
) -> None:
    results = {}
    for kind, graphs in (("alone", alone), ("shared", shared)):
        put_graphs(write_tiny_bundle(tmp_path / kind), graphs)
        opened = Graphs(open_bundle(tmp_path / kind))
        rng = np.random.default_rng(0)
        image, target = rng.random((2, 24, 20, 3), np.float32)
        caption = rng.standard_normal(ENCODER.embedding).astype(np.float32)
        views = [random_views(VIEWS, rng), *(resizing_matrix(side, ENCODER.image_px) for side in image.shape[:2])]
        results[kind] = [*opened("semantic", image, target, *views), *opened("text", image, caption, *views)]
    for found, expected in zip(results["shared"], results["alone"], strict=True):
        assert np.linalg.norm(expected) > 0
        np.testing.assert_array_equal(found, expected)


def test_graphs_of_other_models_small_graphs_and_those_with_little_in_common_stay_as_they_are(
    alone: dict[str, Graph],
) -> None:
    others = alone | {"text": replace(alone["text"], models=("other",))}
    assert share_weights(others, MIN_BYTES) == others
    assert share_weights(alone) == alone  # 32 MiB in common are needed
    small = encoder_graphs(small_encoder(), VIEWS, 1e-4)
    assert all(graph.weights is None for graph in small.values())
    assert share_weights(small, 1) == small
