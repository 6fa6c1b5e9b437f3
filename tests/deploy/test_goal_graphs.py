"""Goal graphs with their tensors in a file of their own, and in half precision, run without PyTorch as the planner."""

from pathlib import Path

import numpy as np
import onnx
import pytest

from pentimento.bundle.graphs import Graphs, goal_networks, noise_schedule
from pentimento.bundle.onnx_header import read_header
from pentimento.bundle.reader import Bundle, open_bundle
from pentimento.bundle.sampler import complete, normal, seed_for
from pentimento.contracts.codec import to_plain
from pentimento.copainting.goal.denoising import tokens_of
from pentimento.copainting.goal.planner import GoalPlanner, GoalSampling, SeededSampling
from pentimento.copainting.goal.planner import complete as complete_in_workshop
from pentimento.deploy import graphs as graph_module
from pentimento.deploy.goal_graphs import goal_facts, goal_graphs
from pentimento.deploy.graphs import Graph, ParityError
from tests.bundle.tiny_bundle import change, write_tiny_bundle
from tests.copainting.goal_planners import CAPTIONS, SIDE_PX, small_planner
from tests.deploy.bundles import put_graphs

TOLERANCE, HALF = 1e-4, 0.02
SEED, STEPS, GUIDANCE = 4, 3, (1.2, 2.0)


@pytest.fixture(scope="module")
def planner() -> GoalPlanner:
    return small_planner()


@pytest.fixture(scope="module")
def outside(planner: GoalPlanner) -> dict[str, Graph]:
    """Graphs in half precision whose tensors lie beside them, here from 10 kB on."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(graph_module, "INLINE_BYTES", 10_000)
        return goal_graphs(planner, TOLERANCE, HALF)


def put(bundle: Path, planner: GoalPlanner, graphs: dict[str, Graph]) -> Bundle:
    """A bundle with these graphs in place of its trivial ones, opened as the runner opens it."""
    write_tiny_bundle(bundle)
    opened = open_bundle(bundle).manifest
    put_graphs(bundle, graphs)
    facts = goal_facts(planner, opened.goal.words, GoalSampling(STEPS, *GUIDANCE), nouns=None)
    change(bundle, goal=to_plain(facts))
    return open_bundle(bundle)


def completed(bundle: Bundle, planner: GoalPlanner, pictures: np.ndarray) -> np.ndarray:
    side = SIDE_PX // planner.vae_scale_factor
    noise = np.concatenate([normal((1, 4, side, side), seed_for(SEED, i)) for i in range(len(pictures))])
    return complete(
        goal_networks(Graphs(bundle)), noise_schedule(bundle), pictures,
        tokens=tokens_of(planner, CAPTIONS[: len(pictures)]).numpy(), no_words=tokens_of(planner, [""]).numpy(),
        noise=noise, steps=STEPS, image_guidance=GUIDANCE[0], text_guidance=GUIDANCE[1],
    )  # fmt: skip


@pytest.mark.timeout(600)
def test_a_bundle_with_tensors_outside_its_graphs_paints_the_planners_goal(
    planner: GoalPlanner, outside: dict[str, Graph], tmp_path: Path
) -> None:
    assert all(graph.weights is not None for graph in outside.values())
    bundle = put(tmp_path / "bundle", planner, outside)
    pictures = np.random.default_rng(0).integers(0, 256, (2, SIDE_PX, SIDE_PX, 3)).astype(np.uint8)
    theirs = complete_in_workshop(planner, pictures, CAPTIONS[:2], SeededSampling(STEPS, *GUIDANCE, SEED))
    assert np.abs(completed(bundle, planner, pictures).astype(int) - theirs).mean() < 2  # of 255, in half precision


def test_small_tensors_stay_in_the_graph_and_large_ones_are_aligned(outside: dict[str, Graph]) -> None:
    for graph in outside.values():
        model = onnx.load_from_string(graph.content)
        for array in model.graph.initializer:
            assert (array.data_location == onnx.TensorProto.EXTERNAL) == (not array.raw_data)
            assert len(array.raw_data) < 1024
        places = read_header(graph.content).external
        assert graph.weights is not None and places
        assert all(place.offset % 64 == 0 and place.length >= 1024 for place in places)
        assert max(place.offset + place.length for place in places) == len(graph.weights.content)


def test_half_precision_halves_all_but_an_autoencoder_that_overflows_in_it(
    planner: GoalPlanner, outside: dict[str, Graph]
) -> None:
    assert planner.vae.config.force_upcast  # as in the published folders
    for name, graph in outside.items():
        kinds = {array.data_type for array in onnx.load_from_string(graph.content).graph.initializer}
        in_half = name in ("goal_text", "goal_denoise")
        assert (onnx.TensorProto.FLOAT16 in kinds) == in_half
        assert graph.tolerance == (HALF if in_half else TOLERANCE) and max(graph.parity.values()) <= graph.tolerance
        assert {port.type for port in graph.outputs} == {"float32"}
    (largest,) = outside["goal_denoise"].parity.values()
    assert largest > 1e-5  # not single precision


@pytest.mark.timeout(600)
def test_half_precision_beyond_its_tolerance_is_an_error(planner: GoalPlanner) -> None:
    with pytest.raises(ParityError, match="above the tolerance of 1e-07"):
        goal_graphs(planner, TOLERANCE, 1e-7)
