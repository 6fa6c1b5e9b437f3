"""x"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from pentimento.bundle.manifest import (
    BrushFacts,
    ClayFacts,
    EncoderFacts,
    FileEntry,
    GraphEntry,
    Manifest,
    Setting,
    StyleFacts,
    WordsFacts,
)
from pentimento.bundle.reader import MANIFEST, SCHEMA
from pentimento.contracts.codec import to_plain
from pentimento.contracts.frames import image_shape
from pentimento.contracts.frames import pixels_per_m as image_scale
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.control.safety import envelope_for
from pentimento.copainting.goal.planner import GoalPlanner, GoalSampling
from pentimento.deploy.goal_graphs import goal_facts, goal_graphs
from pentimento.deploy.graphs import IR_VERSION, OPSET, Graph
from pentimento.deploy.objective_graphs import encoder_graphs, style_graphs
from pentimento.deploy.push_graphs import clay_graphs
from pentimento.deploy.stroke_graphs import brush_graphs
from pentimento.dynamics.pushes.push_model import PushModel, planned_clay
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.robots.tools import load_tool
from pentimento.semantics.encoder import Encoder


@dataclass(frozen=True)
class SettingConfig:
    """A tool before a canvas, and how the runner paints there."""

    tool: str
    canvas_m: tuple[float, float]
    strokes: int
    batch: int
    """Strokes between two photographs."""
    style: bool
    """Whether the runner may paint in the style of a picture there."""
    planner: PlannerConfig

    def __post_init__(self) -> None:
        at_least(self, 1, "strokes", "batch")


@dataclass(frozen=True)
class ClayConfig:
    """What the scanner of a sculpting robot sees."""

    window_m: tuple[float, float, float, float]
    """Canvas frame."""
    shape: tuple[int, int]
    """Of its height maps, [H, W]."""

    def __post_init__(self) -> None:
        image_scale(self.shape, self.window_m)


@dataclass(frozen=True)
class DeployConfig:
    """What goes into a bundle."""

    tolerance: float
    """The most by which a graph may differ from PyTorch, as a share of the norm."""
    views: int
    """Of a picture that an encoder judges, moved at random, beside the plain one."""
    asking: GoalSampling
    settings: dict[str, SettingConfig]
    clays: dict[str, ClayConfig]
    """By material."""

    def __post_init__(self) -> None:
        above_zero(self, "tolerance")
        at_least(self, 0, "views")
        if not self.settings:
            raise ValueError("settings is empty; a bundle is for at least one.")


@dataclass(frozen=True, eq=False)
class Models:
    """What a bundle is made of, by the names of their folders."""

    strokes: Mapping[str, StrokeModel]
    """By tool."""
    encoder: Encoder
    encoder_folder: Path
    goal: GoalPlanner
    goal_folder: Path
    pushes: Mapping[str, PushModel]
    """By material."""
    digests: Mapping[str, str]
    """By which the pipeline knows each: ``stroke_<tool>``, ``semantics``, ``goal``, ``push_<material>``."""


def write_bundle(folder: Path, models: Models, config: DeployConfig) -> Manifest:
    """Write a bundle into an existing, empty folder.

    Raises:
        ParityError: a graph does not compute what PyTorch does.
        ConfigError: a part is of a kind that the runner does not know.
    """
    brushes, graphs = _brushes(models, config)
    styles, style_parts = _styles(config)
    clays, clay_parts = _clays(models, config)
    graphs |= style_parts | clay_parts
    graphs |= encoder_graphs(models.encoder, config.views, config.tolerance)
    graphs |= goal_graphs(models.goal, config.tolerance)
    encoder_words = WordsFacts(
        "words/encoder/vocab.json", "words/encoder/merges.txt", _length(models.encoder.tokenizer)
    )
    goal_words = WordsFacts("words/goal/vocab.json", "words/goal/merges.txt", _length(models.goal.tokenizer))
    contents = {f"graphs/{name}.onnx": graph.content for name, graph in graphs.items()}
    for words, source in (
        (encoder_words, models.encoder_folder),
        (goal_words, models.goal_folder / "tokenizer"),
    ):
        contents[words.vocabulary] = (source / "vocab.json").read_bytes()
        contents[words.merges] = (source / "merges.txt").read_bytes()
    for setting in config.settings.values():
        contents[f"tools/{setting.tool}.toml"] = _robot_file("tools", setting.tool)
    for clay in clays.values():
        contents[f"end_effectors/{clay.end_effector}.toml"] = _robot_file("end_effectors", clay.end_effector)
    entries = {name: _entry(name, graph, config.tolerance) for name, graph in graphs.items()}
    encoder = EncoderFacts(
        models.encoder.image_px, models.encoder.model.config.projection_dim, config.views, encoder_words
    )
    goal = goal_facts(models.goal, goal_words, config.asking)
    settings = {name: _setting(setting) for name, setting in config.settings.items()}
    contents["metrics.json"] = _json(_metrics(graphs))
    contents["card.md"] = bundle_card(settings, entries, {name: len(data) for name, data in contents.items()}).encode()
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
    )
    for name, data in {**contents, MANIFEST: _json(to_plain(manifest))}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return manifest


def brush_name(setting: SettingConfig) -> str:
    """Of a stroke model with so many points in a path."""
    return f"{setting.tool}_{setting.planner.path_points}"


def _brushes(models: Models, config: DeployConfig) -> tuple[dict[str, BrushFacts], dict[str, Graph]]:
    facts: dict[str, BrushFacts] = {}
    graphs: dict[str, Graph] = {}
    for setting in config.settings.values():
        name, points = brush_name(setting), setting.planner.path_points
        if name not in facts:
            model, tool = models.strokes[setting.tool], load_tool(setting.tool)
            facts[name], made = brush_graphs(name, model, tool, points, setting.canvas_m, config.tolerance)
            graphs |= made
    return facts, graphs


def _styles(config: DeployConfig) -> tuple[dict[str, StyleFacts], dict[str, Graph]]:
    """Of pictures as large as each setting's canvas, and half as large: planners begin so."""
    facts: dict[str, StyleFacts] = {}
    graphs: dict[str, Graph] = {}
    for setting in (setting for setting in config.settings.values() if setting.style):
        height, width = image_shape((0.0, 0.0, *setting.canvas_m), setting.planner.pixels_per_m)
        for shape in ((height, width), (max(round(height / 2), 1), max(round(width / 2), 1))):
            name = f"style_{shape[0]}x{shape[1]}"
            if name not in facts:
                facts[name], made = style_graphs(name, shape, config.tolerance)
                graphs |= made
    return facts, graphs


def _clays(models: Models, config: DeployConfig) -> tuple[dict[str, ClayFacts], dict[str, Graph]]:
    facts: dict[str, ClayFacts] = {}
    graphs: dict[str, Graph] = {}
    for material, clay in config.clays.items():
        name, model = f"clay_{material}", models.pushes[material]
        planned = planned_clay(model, np.array(clay.window_m))
        facts[name], made = clay_graphs(name, planned, model.facts, clay.shape, config.tolerance, (f"push_{material}",))
        graphs |= made
    return facts, graphs


def _setting(config: SettingConfig) -> Setting:
    tool = load_tool(config.tool)
    return Setting(
        tool=f"tools/{config.tool}.toml",
        brush=brush_name(config),
        canvas_m=config.canvas_m,
        strokes=config.strokes,
        batch=config.batch,
        planner=config.planner,
        envelope=envelope_for(tool, config.canvas_m),
    )


def _entry(name: str, graph: Graph, tolerance: float) -> GraphEntry:
    return GraphEntry(f"graphs/{name}.onnx", graph.inputs, graph.outputs, graph.parity, tolerance, graph.models)


def _robot_file(folder: str, name: str) -> bytes:
    return (resources.files("pentimento.robots") / folder / f"{name}.toml").read_bytes()


def _length(tokenizer: Any) -> int:
    return int(tokenizer.model_max_length)


def _metrics(graphs: Mapping[str, Graph]) -> dict[str, Any]:
    """For DVC and MLflow."""
    return {
        "parity": {name: max(graph.parity.values()) for name, graph in graphs.items()},
        "largest_difference": max(max(graph.parity.values()) for graph in graphs.values()),
        "graphs_bytes": sum(len(graph.content) for graph in graphs.values()),
    }


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n").encode()


_HEAD = """# bundle

What a robot needs to paint beside a person, without PyTorch: stroke models with their gradients, image objectives with
theirs, the goal planner's parts, tools and safety envelopes. `manifest.json` lists every file with its size and
SHA-256; the runner checks all of it before it opens anything. What each part is good for, and what not, is said by the
cards of the models that it came from.

- **Made by** the stage `deploy`, which compared each graph with PyTorch and wrote the differences below.
- **Used by** `pentimento run`.
"""


def bundle_card(settings: Mapping[str, Setting], graphs: Mapping[str, GraphEntry], sizes: Mapping[str, int]) -> str:
    """Markdown."""
    lines = [_HEAD, "| setting | tool | canvas | strokes | envelope |", "|---|---|---|---|---|"]
    for name, setting in sorted(settings.items()):
        width, height = (1000 * length for length in setting.canvas_m)
        lines.append(
            f"| {name} | {setting.brush} | {width:g} x {height:g} mm | {setting.strokes} | {setting.envelope.id} |"
        )
    lines += [
        "",
        "The difference of a graph is the largest of its outputs' and of several examples': norm of the difference",
        "from PyTorch's over the norm of PyTorch's.",
        "",
        "| graph | from | kB | difference |",
        "|---|---|---|---|",
    ]
    for name, graph in sorted(graphs.items()):
        made_from = ", ".join(graph.models) or "fixed features"
        difference = max(graph.parity.values())
        lines.append(f"| {name} | {made_from} | {sizes[graph.file] / 1000:.1f} | {difference:.1e} |")
    return "\n".join(lines) + "\n"
