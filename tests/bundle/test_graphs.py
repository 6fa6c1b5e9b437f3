"""A bundle's graphs, called as the planner calls them, agree with the PyTorch models."""

import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pentimento.bundle.graphs import (
    GraphBrush,
    GraphMeaning,
    GraphPathBrush,
    Graphs,
    PictureStyle,
    SemanticObjective,
    StyleObjective,
    TextObjective,
    caption_vector,
    goal_networks,
    noise_schedule,
    tokenizer,
)
from pentimento.bundle.manifest import GraphEntry
from pentimento.bundle.reader import Bundle, open_bundle
from pentimento.calibration.observe import calibrate_camera
from pentimento.contracts.covariates import PICKUP_COLUMNS
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.markers import markers_around
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import as_linear
from pentimento.control.safety import envelope_for
from pentimento.deploy.objective_graphs import style_graphs
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.handwriting.drawing import TorchPathBrush, draw_shapes
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import BezierBrush, Marks, PathBrush
from pentimento.planning.strokes.config import no_log
from pentimento.planning.strokes.scene import scene_with
from pentimento.planning.strokes.shapes import ShapedStrokes
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import virtual_robot
from pentimento.semantics.objective import EncoderMeaning, TorchObjective
from pentimento.semantics.style import StyleObjective as TorchStyle
from pentimento.semantics.style_features import LocalFeatures
from tests.bundle.small_hands import HAND_POINTS
from tests.bundle.tiny_bundle import CANVAS_M, HAND_PLANNER, PLANNER
from tests.copainting.goal_planners import CAPTIONS
from tests.deploy.bundles import BRUSH, PATH_BRUSH, small_bundle

pytestmark = pytest.mark.timeout(1200)  # the first test exports everything
Array = NDArray[np.float32]


@pytest.fixture(scope="module")
def graphs() -> Graphs:
    return Graphs(open_bundle(small_bundle()[0]))


@cache
def styles() -> Graphs:
    """A bundle of style graphs alone, for pictures of 32 x 32 px."""
    facts, exported = style_graphs("style", (32, 32), 1e-4)
    entries = {n: GraphEntry(n, None, g.inputs, g.outputs, g.parity, 1e-4, ()) for n, g in exported.items()}
    contents = {name: graph.content for name, graph in exported.items()}
    manifest = replace(open_bundle(small_bundle()[0]).manifest, graphs=entries, styles={"style": facts})
    return Graphs(Bundle(small_bundle()[0], "", manifest, {}, contents, None, {}, {}))


def some_strokes(count: int) -> tuple[Strokes, dict[str, Array]]:
    rng, tool = np.random.default_rng(count), load_tool("marker")
    length = rng.uniform(*tool.stroke_length_m, count)
    arrays = (
        rng.uniform(0, 1, (count, 2)) * CANVAS_M, rng.uniform(-3, 3, count), length,
        length * rng.uniform(*tool.bend_range, count), rng.uniform(*tool.press_range_m, (count, 3)),
        rng.uniform(0, 1, (count, 3)),
    )  # fmt: skip
    inherited = {"ink_since_reload_m": rng.uniform(0, 0.1, count), "wet_age_s": rng.uniform(1, 300, count)}
    inherited["wet_age_s"][::2] = np.nan
    inherited |= {name: rng.uniform(0, 1, count) for name in PICKUP_COLUMNS}
    return Strokes(*(a.astype(np.float32) for a in arrays)), {n: v.astype(np.float32) for n, v in inherited.items()}


def picture(seed: int, height: int = 32, width: int = 48) -> Array:
    return np.random.default_rng(seed).random((height, width, 3), np.float32)


@pytest.mark.parametrize("count", [1, 2, 30])
def test_graph_brush_equals_pytorch(graphs: Graphs, count: int) -> None:
    ours, theirs = GraphBrush(graphs, BRUSH), TorchBrush(
        small_bundle()[1].strokes["marker"], load_tool("marker"), PLANNER.path_points
    )  # fmt: skip
    assert (ours.fitted, ours.timing, ours.path_points) == (theirs.fitted, theirs.timing, theirs.path_points)
    strokes, inherited = some_strokes(count)
    (marks, pull), (expected, pull_expected) = (brush.marks(strokes, inherited) for brush in (ours, theirs))
    for found, wanted in zip(marks, expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-7)
    rng = np.random.default_rng(0)
    cotangent = Marks(*(rng.standard_normal(field.shape).astype(np.float32) for field in marks))
    back, back_expected = pull(cotangent), pull_expected(cotangent)
    for found, wanted in zip(back.arrays(), back_expected.arrays(), strict=True):
        assert np.linalg.norm(found - wanted) <= 1e-4 * np.linalg.norm(wanted)
    places = rng.random((5, 2), np.float32) * np.float32(0.05)
    np.testing.assert_allclose(ours.gain(places), theirs.gain(places), rtol=1e-5)


@pytest.mark.parametrize("count", [1, 30])
def test_graph_path_brush_equals_pytorch(graphs: Graphs, count: int) -> None:
    tool, rng = load_tool("marker"), np.random.default_rng(count)
    ours, theirs = GraphPathBrush(graphs, PATH_BRUSH, tool), TorchPathBrush(
        small_bundle()[1].strokes["marker"], tool, HAND_POINTS
    )  # fmt: skip
    assert isinstance(ours, PathBrush) and not isinstance(ours, BezierBrush)
    assert (ours.fitted, ours.timing, ours.path_points) == (theirs.fitted, theirs.timing, theirs.path_points)
    bezier, inherited = some_strokes(count)
    parameters = graphs.bundle.hand("anna").sample(count, rng)
    strokes = ShapedStrokes(
        graphs.bundle.hand("anna"), 1.0, parameters, parameters.copy(), bezier.middle_m, bezier.theta_rad,
        bezier.press_m, bezier.color,
    )  # fmt: skip
    (marks, pull), (expected, pull_expected) = (strokes.marks(brush, inherited) for brush in (ours, theirs))
    for found, wanted in zip(marks, expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-7)
    cotangent = Marks(*(rng.standard_normal(field.shape).astype(np.float32) for field in marks))
    for found, wanted in zip(pull(cotangent), pull_expected(cotangent), strict=True):
        assert np.linalg.norm(found - wanted) <= 1e-4 * np.linalg.norm(wanted)
    with pytest.raises(ConfigError, match="takes paths only"):
        bezier.marks(ours, inherited)
    with pytest.raises(ConfigError, match="takes Bézier strokes only"):
        strokes.marks(GraphBrush(graphs, BRUSH), inherited)


def test_drawing_in_a_hand_equals_the_workshops(graphs: Graphs) -> None:
    tool, hand = load_tool("marker"), graphs.bundle.hand("anna")
    config = HAND_PLANNER.of(PLANNER, HAND_POINTS)
    workshop = TorchPathBrush(small_bundle()[1].strokes["marker"], tool, HAND_POINTS)
    target = np.ones((round(CANVAS_M[1] * 800), round(CANVAS_M[0] * 800), 3), np.float32)
    target[8:12, 8:40] = target[12:26, 22:26] = 0.05
    errors = []
    for brush in (GraphPathBrush(graphs, PATH_BRUSH, tool), workshop):
        robot = GuardedRobot(virtual_robot("marker", CANVAS_M, 3), envelope_for(tool, CANVAS_M))
        robot.change_tool(tool)
        calibration = calibrate_camera(robot.photo(), markers_around(CANVAS_M))
        drawing = draw_shapes(
            robot, calibration, scene_with(brush, tool, CANVAS_M, target), shapes=hand, ink_m=0.15, replan_every=4,
            config=config, log=no_log,
        )  # fmt: skip
        assert len(drawing.executed) > 4
        errors.append(PrintObjective(target, config.distances_px)(as_linear(drawing.photo))[0])
    assert errors[0] == pytest.approx(errors[1], rel=0.02)


def test_graph_brush_pull_uses_the_strokes_of_the_forward_pass(graphs: Graphs) -> None:
    strokes, inherited = some_strokes(3)
    marks, pull = GraphBrush(graphs, BRUSH).marks(strokes, inherited)
    cotangent = Marks(*(np.ones_like(field) for field in marks))
    before = pull(cotangent)
    strokes.theta_rad += 1.0
    for found, wanted in zip(pull(cotangent).arrays(), before.arrays(), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_graph_objectives_decrease_along_their_gradient(graphs: Graphs) -> None:
    for make in (
        lambda: SemanticObjective(graphs, picture(2, 32, 32), 5),
        lambda: TextObjective(graphs, CAPTIONS[0], (32, 32), 5),
        lambda: StyleObjective(styles(), picture(3, 32, 32), 5),
    ):
        image = 0.25 + 0.5 * picture(1, 32, 32)
        value, gradient = make()(image)
        size = 0.02 * value / np.square(gradient).sum()  # lowers it by about 2 %
        after = make()(image - np.float32(size) * gradient)[0]  # the same seed: the same views
        assert after == pytest.approx(0.98 * value, rel=0.008)


def test_meaning_equals_pytorch_in_the_same_views(graphs: Graphs) -> None:
    views, seed = graphs.bundle.manifest.encoder.views, 3
    here, there = GraphMeaning(graphs, seed), EncoderMeaning(small_bundle()[1].encoder, views, seed)
    target, image = picture(2, 40, 32), picture(3, 40, 32)
    for mine, theirs in (
        (here.semantic(target), there.semantic(target)),
        (here.text(CAPTIONS[0], (40, 32)), there.text(CAPTIONS[0], (40, 32))),
    ):
        for _ in range(2):  # each call draws other views
            (value, gradient), (expected, of_image) = mine(image), theirs(image)
            assert value == pytest.approx(expected, rel=1e-4)
            assert np.linalg.norm(gradient - of_image) <= 1e-4 * np.linalg.norm(of_image)


def test_semantic_objective_of_the_target_is_zero(graphs: Graphs) -> None:
    for shape in ((32, 48), (17, 90)):
        target = picture(4, *shape)
        objective = SemanticObjective(graphs, target, 0)
        assert objective(target)[0] == pytest.approx(0, abs=1e-9)
        assert objective(1 - target)[0] > 1e-6
        assert objective(1 - target)[1].shape == target.shape


def test_views_are_seeded_and_differ_between_calls(graphs: Graphs) -> None:
    one, other = (TextObjective(graphs, CAPTIONS[1], (32, 48), 7) for _ in range(2))
    image = picture(5)
    first = one(image)[0]
    assert other(image)[0] == first != one(image)[0]


def test_caption_vector_equals_pytorch(graphs: Graphs) -> None:
    encoder = small_bundle()[1].encoder
    for caption in (*CAPTIONS, "", "a word " * 40):
        expected = encoder.embed_texts([caption])[0].detach().numpy()
        np.testing.assert_allclose(caption_vector(graphs, caption), expected, atol=1e-5)


def test_style_objective_equals_pytorch() -> None:
    style, image = picture(6, 32, 32), picture(7, 32, 32)
    expected, slope = TorchObjective(TorchStyle(torch.from_numpy(style), LocalFeatures(), 0))(image)
    value, gradient = StyleObjective(styles(), style, 0)(image)
    assert value == pytest.approx(expected, rel=1e-5)
    assert np.linalg.norm(gradient - slope) <= 1e-4 * np.linalg.norm(slope)
    assert StyleObjective(styles(), style, 0)(style)[0] == pytest.approx(0, abs=1e-4)


def test_picture_style_is_limited_to_deployed_sizes() -> None:
    bytes_srgb = np.random.default_rng(8).integers(0, 256, (40, 90, 3)).astype(np.uint8)
    style = PictureStyle(styles(), bytes_srgb, 0)
    assert style.picture((32, 32)).shape == (32, 32, 3)
    assert style.objective((32, 32))(picture(9, 32, 32))[0] > 0
    with pytest.raises(ConfigError, match="of 32 x 32 px, not of 20 x 20 px"):
        style.objective((20, 20))
    with pytest.raises(ContractError, match="not finite"):
        style.objective((32, 32))(np.full((32, 32, 3), np.nan, np.float32))


def test_goal_networks_equal_pytorch(graphs: Graphs) -> None:
    planner, networks = small_bundle()[1].goal, goal_networks(graphs)
    schedule, rng = noise_schedule(graphs.bundle), np.random.default_rng(0)
    words = tokenizer(graphs.bundle, graphs.bundle.manifest.goal.words).encode(["a red disc", "a blue square"])
    pictures = rng.uniform(-1, 1, (2, 3, 16, 16)).astype(np.float32)
    with torch.no_grad():
        states = planner.text_encoder(torch.from_numpy(words))[0]
        latents = planner.vae.encode(torch.from_numpy(pictures)).latent_dist.mode()
        noisy = torch.cat([latents, latents], 1)
        expected = planner.unet(noisy, 400, encoder_hidden_states=states).sample
        decoded = planner.vae.decode(latents).sample
    np.testing.assert_allclose(networks.read(words), states, atol=1e-5)
    np.testing.assert_allclose(networks.encode(pictures), latents, atol=1e-4)
    np.testing.assert_allclose(networks.predict(noisy.numpy(), 400, states.numpy()), expected, atol=1e-4)
    np.testing.assert_allclose(networks.decode(latents.numpy()), decoded, atol=1e-4)
    assert schedule.alphas_cumprod[-1] == 0 and schedule.prediction == "sample"


def test_graphs_import_no_pytorch() -> None:
    script = (
        "import sys; from pathlib import Path; from pentimento.bundle.graphs import Graphs, caption_vector;"
        "from pentimento.bundle.reader import open_bundle;"
        f"caption_vector(Graphs(open_bundle(Path({str(small_bundle()[0])!r}))), 'a red disc');"
        "sys.exit('torch' in sys.modules or 'onnx' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
