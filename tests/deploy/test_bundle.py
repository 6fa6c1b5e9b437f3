"""A written bundle opens and agrees with its models."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pentimento.bundle.clays import clay_members
from pentimento.bundle.graphs import Graphs
from pentimento.bundle.reader import open_bundle
from pentimento.contracts.errors import ConfigError
from pentimento.control.safety import envelope_for
from pentimento.deploy.bundle import bundle_card, check_deployed_clays, write_bundle
from pentimento.deploy.graphs import ParityError
from pentimento.deploy.stroke_graphs import MARKS, STROKES
from pentimento.deploy.words import taught_vocabulary
from pentimento.dynamics.pushes.push_model import planned_members
from pentimento.planning.pushes.analytic.correction import CorrectedClay
from pentimento.planning.pushes.memory import FRESH, PushMemory
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
    deployed, diagnosed = clay_members(Graphs(bundle), "clay_foam"), diagnosed_members()
    assert len(deployed) == 2
    height = (0.04 + 5e-4 * np.random.default_rng(0).standard_normal(facts.shape)).astype(np.float32)
    actions = np.array([[0.05, 0.04, 0.7, 0.015, 0.006], [0.04, 0.04, 0.1, 0.01, 0.005]])
    worked = PushMemory((actions[0], actions[0], actions[1]), {"t_start_s": 550.0})
    for one, other in zip(deployed, diagnosed, strict=True):
        for memory in (FRESH, worked):
            after, expected = (model.after(height, actions, memory) for model in (one, other))
            assert np.linalg.norm(after - expected) < 1e-4 * np.linalg.norm(expected - height)
        # Where it was pushed before, and late in the session, a push goes less deep.
        assert (one.after(height, actions) - one.after(height, actions, worked)).min() < -3e-4
    assert check_deployed_clays(bundle, models, CONFIG.tolerance)["foam"] <= 1e-4


def test_a_bundle_with_another_correction_than_the_diagnosed_one_is_refused() -> None:
    folder, models = small_bundle()
    foam = models.corrections["foam"]
    deeper = replace(foam, extended=foam.extended.at(foam.extended.vector * 1.01))
    with pytest.raises(ParityError, match="push model of foam differs from the diagnosed one"):
        check_deployed_clays(open_bundle(folder), replace(models, corrections={"foam": deeper}), CONFIG.tolerance)


def diagnosed_members() -> list[CorrectedClay]:
    models = small_bundle()[1]
    window = np.array(CONFIG.clays["foam"].window_m)
    return [CorrectedClay(one, models.corrections["foam"]) for one in planned_members(models.pushes["foam"], window)]


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
