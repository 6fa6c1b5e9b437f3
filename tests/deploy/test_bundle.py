"""A written bundle opens and agrees with its models."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pentimento.bundle.graphs import GraphClay, Graphs
from pentimento.bundle.reader import open_bundle
from pentimento.contracts.errors import ConfigError
from pentimento.control.safety import envelope_for
from pentimento.deploy.bundle import bundle_card, write_bundle
from pentimento.deploy.stroke_graphs import MARKS, STROKES
from pentimento.deploy.words import taught_vocabulary
from pentimento.dynamics.pushes.push_model import planned_clay
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import Marks
from pentimento.robots.tools import load_tool
from tests.bundle.small_hands import small_hand
from tests.bundle.tiny_bundle import CANVAS_M
from tests.control.sculpting_bundle import SETTINGS
from tests.deploy.bundles import BRUSH, CONFIG, DIGESTS, PATH_BRUSH, small_bundle

pytestmark = pytest.mark.timeout(1200)  # the first test exports everything


def test_written_bundle_opens_with_parity_of_each_graph() -> None:
    folder, _ = small_bundle()
    manifest = open_bundle(folder).manifest
    assert {f"{BRUSH}_marks", f"{BRUSH}_pull", f"{BRUSH}_gain", "semantic", "text", "caption", "goal_denoise"} <= set(
        manifest.graphs
    )
    for name, graph in manifest.graphs.items():
        assert max(graph.parity.values()) <= CONFIG.tolerance, name
        assert set(graph.models) <= set(DIGESTS)
    assert manifest.models == DIGESTS
    assert manifest.sculpting == {"clay_foam": SETTINGS}
    assert manifest.settings["small"].envelope == envelope_for(load_tool("marker"), CANVAS_M)


def test_bundle_facts_are_those_of_the_models() -> None:
    folder, models = small_bundle()
    manifest = open_bundle(folder).manifest
    goal, brush = manifest.goal, manifest.brushes[BRUSH]
    assert (goal.side_px, goal.latent_step_px, goal.latent_channels, goal.prediction) == (16, 2, 4, "sample")
    assert goal.alphas_cumprod[-1] == 0 and np.all(np.diff(goal.alphas_cumprod) < 0)
    assert goal.alphas_cumprod == pytest.approx(models.goal.scheduler.alphas_cumprod.tolist())
    assert brush.fitted == models.strokes["marker"].fitted and brush.timing == models.strokes["marker"].timing
    assert brush.picks_up and brush.has_gain


def test_bundle_carries_the_vocabulary_of_the_goal_planner() -> None:
    folder, _ = small_bundle()
    opened = open_bundle(folder)
    assert opened.manifest.goal.nouns == "words/nouns.json"
    assert opened.vocabulary == taught_vocabulary("named")


def test_push_model_of_the_bundle_agrees_with_pytorch() -> None:
    folder, models = small_bundle()
    bundle = open_bundle(folder)
    facts = bundle.manifest.clays["clay_foam"]
    assert (facts.end_effector, facts.kind, facts.shape) == ("ball", "push", (40, 50))
    assert "end_effectors/ball.toml" in bundle.contents
    height = (0.04 + 5e-4 * np.random.default_rng(0).standard_normal(facts.shape)).astype(np.float32)
    action = np.array([[0.05, 0.04, 0.7, 0.015, 0.006]])
    window = np.array(CONFIG.clays["foam"].window_m)
    carried = GraphClay(Graphs(bundle), "clay_foam", facts).after(height, action)
    np.testing.assert_allclose(carried, planned_clay(models.pushes["foam"], window).after(height, action), atol=1e-7)
    assert (carried[0] - height).min() < -1e-3


def test_bundle_carries_hands_and_its_card_says_whose_they_are() -> None:
    folder, models = small_bundle()
    opened = open_bundle(folder)
    assert opened.manifest.settings["small"].path_brush == PATH_BRUSH
    latent = np.random.default_rng(0).normal(size=(3, 2)).astype(np.float32)
    for name, decoder in models.hands.items():
        np.testing.assert_array_equal(opened.hand(name).decode(latent)[0], decoder.decode(latent)[0])
    card = (folder / "card.md").read_text()
    assert "| anna | a person, recorded |" in card and "| arcs | a synthetic writer |" in card


def test_hands_of_several_numbers_of_points_are_refused(tmp_path: Path) -> None:
    models = replace(small_bundle()[1], hands={"anna": small_hand("anna"), "bert": small_hand("bert", 5)})
    with pytest.raises(ConfigError, match=r"number of points, {'anna': 6, 'bert': 5}"):
        write_bundle(tmp_path, models, CONFIG)


@pytest.mark.parametrize("name", ["Anna", "", "../anna", "anna b"])
def test_hands_that_cannot_be_files_are_refused(tmp_path: Path, name: str) -> None:
    models = replace(small_bundle()[1], hands={name: small_hand(name)})
    with pytest.raises(ConfigError, match="cannot be a file of the bundle"):
        write_bundle(tmp_path, models, CONFIG)


def test_bundle_card_states_the_licence_of_weights_that_learned_from_named_drawings() -> None:
    assert "CC BY-SA 4.0" in bundle_card({}, {}, {}, {}, named=True)
    assert "CC BY-SA" not in bundle_card({}, {}, {}, {}, named=False)


def test_bundle_card_lists_graphs_without_paths_or_times() -> None:
    folder, models = small_bundle()
    card = (folder / "card.md").read_text()
    manifest = open_bundle(folder).manifest
    assert all(f"| {name} |" in card for name in manifest.graphs)
    for name in ("card.md", "manifest.json", "metrics.json"):
        text = (folder / name).read_text()
        assert str(models.goal_folder.parent) not in text and "T00:" not in text
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["largest_difference"] == max(max(g.parity.values()) for g in manifest.graphs.values())


def test_port_names_are_the_planners_fields() -> None:
    assert tuple(STROKES) == Strokes.row_arrays
    assert [*MARKS] == [name if name != "color" else "paint" for name in Marks._fields]
