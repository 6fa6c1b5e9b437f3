"""Writing a bundle: its files, the manifest that lists them, and its card."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from pentimento.bundle.clays import clay_members
from pentimento.bundle.graphs import Graphs
from pentimento.bundle.manifest import (
    BrushFacts,
    ClayFacts,
    EncoderFacts,
    FileEntry,
    GraphEntry,
    HandFacts,
    Manifest,
    Setting,
    StyleFacts,
    WordsFacts,
)
from pentimento.bundle.reader import FILE_NAME, MANIFEST, SCHEMA, Bundle
from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.frames import image_shape
from pentimento.contracts.frames import pixels_per_m as image_scale
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.control.safety import envelope_for
from pentimento.control.sculpting_settings import SculptingSettings
from pentimento.copainting.goal.planner import GoalPlanner, GoalSampling
from pentimento.deploy.goal_graphs import goal_facts, goal_graphs
from pentimento.deploy.graphs import IR_VERSION, OPSET, Graph, ParityError
from pentimento.deploy.objective_graphs import encoder_graphs, style_graphs
from pentimento.deploy.push_graphs import clay_facts, clay_graphs, deployed_difference
from pentimento.deploy.shared_weights import share_weights
from pentimento.deploy.stroke_graphs import brush_graphs
from pentimento.deploy.words import Things, taught_vocabulary
from pentimento.dynamics.pushes.push_model import PushModel, TorchClay, planned_members
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.handwriting.synthetic_writers import HANDS
from pentimento.planning.pushes.analytic.correction import CorrectedClay, Correction, correction_as_json
from pentimento.planning.pushes.places import PlaceModel, place_model_bytes
from pentimento.planning.strokes.config import HandPlanConfig, PlannerConfig
from pentimento.planning.strokes.latent import StyleDecoder, decoder_bytes
from pentimento.robots.tools import load_tool
from pentimento.semantics.encoder import Encoder

_NOUNS: Final = "words/nouns.json"
_LICENCE: Final = """- **Licence** of the goal planner and the encoder, which learned from drawings by OpenMoji
  (https://openmoji.org): CC BY-SA 4.0.
"""
_HEAD: Final = """# bundle

What a robot needs to paint together with a person, without PyTorch: stroke models and image objectives with their
gradients, the parts of the goal planner, tools and safety envelopes. `manifest.json` lists every file with its size and
SHA-256, which are checked before any file is opened. The limits of each part are in the card of the model that it was
exported from.

- **Made by** the stage `deploy`, which compared each graph with PyTorch and wrote the differences below.
- **Used by** `pentimento run`.
"""


@dataclass(frozen=True)
class SettingConfig:
    """A tool and a canvas, and how the robot paints there."""

    tool: str
    words: str
    """What a request to the goal planner says of the medium."""
    canvas_m: tuple[float, float]
    strokes: int
    replan_every: int
    """Strokes between two photographs, each of which replans the rest."""
    style: bool
    """Whether the bundle supports painting in the style of a picture there."""
    planner: PlannerConfig

    def __post_init__(self) -> None:
        at_least(self, 1, "strokes", "replan_every")


@dataclass(frozen=True)
class ClayConfig:
    """The field of view of a sculpting robot's scanner, and how the material is sculpted."""

    window_m: tuple[float, float, float, float]
    """Canvas frame."""
    shape: tuple[int, int]
    """Of its height maps, [H, W]."""
    sculpting: SculptingSettings

    def __post_init__(self) -> None:
        image_scale(self.shape, self.window_m)


@dataclass(frozen=True)
class DeployConfig:
    """The content of a bundle."""

    tolerance: float
    """Maximum difference of a graph from PyTorch, relative to the norm."""
    half_tolerance: float | None
    """The same of the goal planner's graphs in half precision; null exports them in single precision. The autoencoder's
    stay in single precision where its config says `force_upcast`, as published.
    """
    views: int
    """Random views of a picture in the encoder's objectives, in addition to the plain one."""
    sampling: GoalSampling
    """Of the goal planner."""
    vocabulary: Things | None
    """The things that the goal planner was taught, into which requests are put; null if it knows all words."""
    settings: dict[str, SettingConfig]
    clays: dict[str, ClayConfig]
    """By material."""
    hand_planner: HandPlanConfig
    """How strokes are planned in a person's hand, in every setting."""

    def __post_init__(self) -> None:
        above_zero(self, "tolerance")
        if self.half_tolerance is not None:
            above_zero(self, "half_tolerance")
        at_least(self, 0, "views")
        if not self.settings:
            raise ValueError("settings is empty; a bundle is for at least one.")


@dataclass(frozen=True, eq=False)
class Models:
    """The models of a bundle."""

    strokes: Mapping[str, StrokeModel]
    """By tool."""
    encoder: Encoder
    encoder_folder: Path
    goal: GoalPlanner
    goal_folder: Path
    pushes: Mapping[str, PushModel]
    """By material."""
    digests: Mapping[str, str]
    """Of the pipeline, for each of `stroke_<tool>`, `semantics`, `goal` and `push_<material>`; and `hands`."""
    hands: Mapping[str, StyleDecoder] = field(default_factory=dict)
    """Handwriting styles by the writer's name."""
    corrections: Mapping[str, Correction] = field(default_factory=dict)
    """Of push models, by material."""
    places: Mapping[str, PlaceModel] = field(default_factory=dict)
    """Place models by material."""


def write_bundle(folder: Path, models: Models, config: DeployConfig) -> Manifest:
    """Write a bundle into an existing, empty folder.

    Raises:
        ParityError: a graph does not compute what PyTorch does.
        ConfigError: the lean core does not support a part, or the hands differ in their number of points.
    """
    models.encoder.model.cpu()  # graphs are exported and compared there
    models.goal.to("cpu")
    points = _hand_points(models.hands)
    hands = {name: _hand_facts(name) for name in models.hands}
    brushes, graphs = _brushes(models, config, points)
    styles, style_parts = _styles(config)
    clays, clay_parts = _clays(models, config)
    graphs |= style_parts | clay_parts
    graphs |= encoder_graphs(models.encoder, config.views, config.tolerance)
    graphs |= goal_graphs(models.goal, config.tolerance, config.half_tolerance)
    graphs = share_weights(graphs)
    encoder_words = WordsFacts(
        "words/encoder/vocab.json", "words/encoder/merges.txt", _length(models.encoder.tokenizer)
    )
    goal_words = WordsFacts("words/goal/vocab.json", "words/goal/merges.txt", _length(models.goal.tokenizer))
    contents = graph_files(graphs)
    for words, source in (
        (encoder_words, models.encoder_folder),
        (goal_words, models.goal_folder / "tokenizer"),
    ):
        contents[words.vocabulary] = (source / "vocab.json").read_bytes()
        contents[words.merges] = (source / "merges.txt").read_bytes()
    for setting in config.settings.values():
        contents[f"tools/{setting.tool}.toml"] = _robot_file("tools", setting.tool)
    for material, correction in models.corrections.items():
        contents[_correction_file(material)] = _json(correction_as_json(correction))
    for material, places in models.places.items():
        contents[_places_file(material)] = place_model_bytes(places)
    for feeder in {clay.sculpting.feeder for clay in config.clays.values()} - {None}:
        contents[f"feeders/{feeder}.toml"] = _robot_file("feeders", str(feeder))
    for clay in clays.values():
        contents[f"end_effectors/{clay.end_effector}.toml"] = _robot_file("end_effectors", clay.end_effector)
    entries = {name: graph_entry(name, graph) for name, graph in graphs.items()}
    encoder = EncoderFacts(
        models.encoder.image_px, models.encoder.model.config.projection_dim, config.views, encoder_words
    )
    if config.vocabulary is not None:
        contents[_NOUNS] = (
            json.dumps(to_plain(taught_vocabulary(config.vocabulary)), ensure_ascii=False) + "\n"
        ).encode()
    goal = goal_facts(models.goal, goal_words, config.sampling, nouns=None if config.vocabulary is None else _NOUNS)
    settings = {name: _setting(setting, points) for name, setting in config.settings.items()}
    contents |= {hands[name].file: decoder_bytes(decoder) for name, decoder in models.hands.items()}
    contents["metrics.json"] = _json(_metrics(graphs))
    sizes = {name: len(data) for name, data in contents.items()}
    card = bundle_card(settings, entries, sizes, hands, named=config.vocabulary == "named")
    contents["card.md"] = card.encode()
    manifest = Manifest(
        schema=SCHEMA,
        opset=OPSET,
        ir_version=IR_VERSION,
        files={name: FileEntry(len(data), hashlib.sha256(data).hexdigest()) for name, data in contents.items()},
        graphs=entries,
        models=dict(models.digests),
        settings=settings,
        brushes=brushes,
        encoder=encoder,
        goal=goal,
        styles=styles,
        clays=clays,
        sculpting={f"clay_{material}": clay.sculpting for material, clay in config.clays.items()},
        hands=hands,
        hand_planner=config.hand_planner,
    )
    for name, data in {**contents, MANIFEST: _json(to_plain(manifest))}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return manifest


def brush_name(setting: SettingConfig) -> str:
    """The name of a stroke model with the number of points of its paths."""
    return f"{setting.tool}_{setting.planner.path_points}"


def _path_brush_name(tool: str, points: int | None) -> str | None:
    return None if points is None else f"{tool}_{points}_path"


def _hand_points(hands: Mapping[str, StyleDecoder]) -> int | None:
    """The number of points of the hands' paths; None without hands.

    Raises:
        ConfigError: they differ.
    """
    points = {name: decoder.points for name, decoder in hands.items()}
    if len({*points.values()}) > 1:
        raise ConfigError(f"The hands' paths differ in the number of points, {points}: train them together.")
    return next(iter(points.values()), None)


def _hand_facts(name: str) -> HandFacts:
    """Raises ConfigError where a writer's name cannot be a file's in the bundle."""
    facts = HandFacts(f"hands/{name}.npz", synthetic=name in HANDS)
    if not FILE_NAME.fullmatch(facts.file):
        raise ConfigError(
            f"The hand {name!r} cannot be a file of the bundle: name writers by small letters, digits, '_', '-' and '.'"
        )
    return facts


def _brushes(
    models: Models, config: DeployConfig, hand_points: int | None
) -> tuple[dict[str, BrushFacts], dict[str, Graph]]:
    """For Bézier strokes; and, with hands, for paths of their number of points."""
    facts: dict[str, BrushFacts] = {}
    graphs: dict[str, Graph] = {}
    for setting in config.settings.values():
        model, tool = models.strokes[setting.tool], load_tool(setting.tool)
        wanted = {brush_name(setting): setting.planner.path_points}
        by_path = _path_brush_name(setting.tool, hand_points)
        if by_path is not None and hand_points is not None:
            wanted[by_path] = hand_points
        for name, points in wanted.items():
            if name not in facts:
                facts[name], of_brush = brush_graphs(
                    name, model, tool, path_points=points, canvas_m=setting.canvas_m, tolerance=config.tolerance,
                    takes_paths=name == by_path,
                )  # fmt: skip
                graphs |= of_brush
    return facts, graphs


def _styles(config: DeployConfig) -> tuple[dict[str, StyleFacts], dict[str, Graph]]:
    """Of pictures in the size of each setting's canvas, and of half that size, which planners use first."""
    facts: dict[str, StyleFacts] = {}
    graphs: dict[str, Graph] = {}
    for setting in (setting for setting in config.settings.values() if setting.style):
        height, width = image_shape((0.0, 0.0, *setting.canvas_m), setting.planner.pixels_per_m)
        for shape in ((height, width), (max(round(height / 2), 1), max(round(width / 2), 1))):
            name = f"style_{shape[0]}x{shape[1]}"
            if name not in facts:
                facts[name], of_style = style_graphs(name, shape, config.tolerance)
                graphs |= of_style
    return facts, graphs


def _clays(models: Models, config: DeployConfig) -> tuple[dict[str, ClayFacts], dict[str, Graph]]:
    facts: dict[str, ClayFacts] = {}
    graphs: dict[str, Graph] = {}
    for material, clay in config.clays.items():
        name, model = f"clay_{material}", models.pushes[material]
        members = planned_members(model, np.array(clay.window_m))
        correction = _correction_file(material) if material in models.corrections else None
        places = _places_file(material) if material in models.places else None
        if clay.sculpting.feeder is not None and places is None:
            raise ConfigError(
                f"{material} is sculpted with the feeder {clay.sculpting.feeder} and has no place model: collect "
                "pellets of it (params.yaml: collect_pushes.pellets), or set the feeder to null."
            )
        facts[name] = replace(clay_facts(members, model.facts, clay.shape, correction), places=places)
        for number, member in enumerate(members):
            graphs |= clay_graphs(
                f"{name}_{number}", member, model.facts, shape=clay.shape, tolerance=config.tolerance,
                models=(f"push_{material}",),
            )  # fmt: skip
    return facts, graphs


def _places_file(material: str) -> str:
    return f"places/clay_{material}.json"


def _correction_file(material: str) -> str:
    return f"corrections/clay_{material}.json"


def check_deployed_clays(bundle: Bundle, models: Models, tolerance: float) -> dict[str, float]:
    """By material, the relative difference of the bundle's push model from the one that was diagnosed.

    Raises:
        ParityError: one exceeds the tolerance.
    """
    differences = {}
    for material, model in models.pushes.items():
        facts = bundle.manifest.clays[f"clay_{material}"]
        members: tuple[TorchClay | CorrectedClay, ...] = planned_members(model, np.array(facts.window_m))
        correction = models.corrections.get(material)
        ranges = {}
        if correction is not None:
            members = tuple(CorrectedClay(member, correction) for member in members)
            ranges = {name: (known.low, known.high) for name, known in correction.covariates.items()}
        found = deployed_difference(clay_members(Graphs(bundle), f"clay_{material}"), members, facts, ranges)
        if not found <= tolerance:
            raise ParityError(
                f"The bundle's push model of {material} differs from the diagnosed one by {found:.1e}, and "
                f"{tolerance:g} is the tolerance; look for an operator that the export changes."
            )
        differences[material] = found
    return differences


def _setting(config: SettingConfig, hand_points: int | None) -> Setting:
    tool = load_tool(config.tool)
    return Setting(
        tool=f"tools/{config.tool}.toml",
        brush=brush_name(config),
        path_brush=_path_brush_name(config.tool, hand_points),
        words=config.words,
        canvas_m=config.canvas_m,
        strokes=config.strokes,
        replan_every=config.replan_every,
        planner=config.planner,
        envelope=envelope_for(tool, config.canvas_m),
    )


def graph_files(graphs: Mapping[str, Graph]) -> dict[str, bytes]:
    """The graphs and their tensors, by the names of their files in the bundle."""
    files = {f"graphs/{name}.onnx": graph.content for name, graph in graphs.items()}
    outside = [graph.weights for graph in graphs.values() if graph.weights is not None]
    return files | {f"graphs/{weights.file}": weights.content for weights in outside}


def graph_entry(name: str, graph: Graph) -> GraphEntry:
    """The manifest's entry of a graph."""
    weights = None if graph.weights is None else f"graphs/{graph.weights.file}"
    return GraphEntry(
        f"graphs/{name}.onnx", weights, graph.inputs, graph.outputs, graph.parity, graph.tolerance, graph.models
    )


def _robot_file(folder: str, name: str) -> bytes:
    return (resources.files("pentimento.robots") / folder / f"{name}.toml").read_bytes()


def _length(tokenizer: Any) -> int:
    return int(tokenizer.model_max_length)


def _metrics(graphs: Mapping[str, Graph]) -> dict[str, Any]:
    """Metrics for DVC and MLflow."""
    return {
        "parity": {name: max(graph.parity.values()) for name, graph in graphs.items()},
        "largest_difference": max(max(graph.parity.values()) for graph in graphs.values()),
        "graphs_bytes": sum(map(len, graph_files(graphs).values())),
    }


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n").encode()


def bundle_card(
    settings: Mapping[str, Setting],
    graphs: Mapping[str, GraphEntry],
    sizes: Mapping[str, int],
    hands: Mapping[str, HandFacts],
    *,
    named: bool,
) -> str:
    """The card of a bundle in Markdown; `named` if the goal planner was taught drawings of named things."""
    lines = [_HEAD + _LICENCE * named, "| setting | tool | canvas | strokes | envelope |", "|---|---|---|---|---|"]
    for name, setting in sorted(settings.items()):
        width, height = (1000 * length for length in setting.canvas_m)
        lines.append(
            f"| {name} | {setting.brush} | {width:g} x {height:g} mm | {setting.strokes} | {setting.envelope.id} |"
        )
    if hands:
        lines += ["", "| hand | whose strokes it learned from |", "|---|---|"]
    for name, hand in sorted(hands.items()):
        lines.append(f"| {name} | {'a synthetic writer' if hand.synthetic else 'a person, recorded'} |")
    lines += [
        "",
        "The difference of a graph is the norm of the difference from PyTorch over the norm of PyTorch's result, the",
        "maximum over its outputs and several examples. The size of a graph includes its file of tensors, which it may",
        "share with others.",
        "",
        "| graph | from | kB | difference |",
        "|---|---|---|---|",
    ]
    for name, graph in sorted(graphs.items()):
        origin = ", ".join(graph.models) or "fixed features"
        difference = max(graph.parity.values())
        size = sizes[graph.file] + (0 if graph.weights is None else sizes[graph.weights])
        lines.append(f"| {name} | {origin} | {size / 1000:.1f} | {difference:.1e} |")
    return "\n".join(lines) + "\n"
