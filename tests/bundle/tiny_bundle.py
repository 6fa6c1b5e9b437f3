"""Test support: a bundle with trivial graphs, without PyTorch, for tests of defects."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import ArrayLike
from onnx import TensorProto, helper, numpy_helper
from onnx.parser import parse_model

from pentimento.bundle.manifest import (
    BrushFacts,
    EncoderFacts,
    FileEntry,
    GoalFacts,
    GraphEntry,
    Manifest,
    Port,
    Setting,
    WordsFacts,
)
from pentimento.bundle.reader import MANIFEST, SCHEMA
from pentimento.contracts.codec import to_plain
from pentimento.control.safety import envelope_for
from pentimento.planning.strokes.brush import StrokeTiming
from pentimento.planning.strokes.config import (
    PRINT_ALONE,
    ExecutionNoise,
    HandPlanConfig,
    LearningRates,
    PlannerConfig,
)
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.robots.tools import load_tool

CANVAS_M = (0.06, 0.04)
OPSET, IR_VERSION = 20, 10
GRAPHS = (
    "semantic", "text", "caption", "goal_text", "goal_encode", "goal_denoise", "goal_decode", "pen_marks", "pen_pull",
)  # fmt: skip

PLANNER = PlannerConfig(
    initialisation="error_guided", candidates=2, rounds=1, sizes=(0.5, 0.1), iterations_per_round=2, iterations_free=4,
    iterations_palette=0, iterations_replan=2, replan_rate=0.3, relocate_every=0, relocate_share=0.2,
    min_gain_per_stroke=0.0,
    palette=PaletteChoice("ink", None, None, None), sweeps=1, path_points=4, pixels_per_m=800.0, edge_m=0.002,
    distances_px=(1, 4), objectives=PRINT_ALONE, execution_noise=ExecutionNoise(0.0, 0.0),
    learning_rates=LearningRates(8e-4, 0.04, 8e-4, 5e-4, 2e-5, 0.0), seed=1,
)  # fmt: skip


HAND_PLANNER = HandPlanConfig(rounds=2, max_latent_distance=1.0, shape_rate=0.05)


def graph(opset: int = OPSET, ir_version: int = IR_VERSION, domain: str = "") -> onnx.ModelProto:
    """y = x + 1 for x [n, 2]."""
    ports = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", 2]) for name in ("x", "y")]
    one = numpy_helper.from_array(np.ones((1, 2), np.float32), "one")
    node = helper.make_node("Add", ["x", "one"], ["y"], domain=domain)
    inner = helper.make_graph([node], "graph", ports[:1], ports[1:], [one])
    sets = [helper.make_opsetid("", opset)] + ([helper.make_opsetid(domain, 1)] if domain else [])
    return helper.make_model(inner, opset_imports=sets, ir_version=ir_version)


def write_tiny_bundle(folder: Path) -> Path:
    """Write the bundle into a new folder."""
    tool_file = (resources.files("pentimento.robots") / "tools" / "marker.toml").read_bytes()
    contents = {f"graphs/{name}.onnx": graph().SerializeToString() for name in GRAPHS}
    contents |= {"tools/marker.toml": tool_file, "words/vocab.json": b"{}", "words/merges.txt": b"\n"}
    words = WordsFacts("words/vocab.json", "words/merges.txt", 8)
    x, y = (Port(name, ("n", 2), "float32", "1") for name in ("x", "y"))
    setting = Setting(
        "tools/marker.toml", "pen", None, "with a marker", CANVAS_M, 6, 3, PLANNER,
        envelope_for(load_tool("marker"), CANVAS_M),
    )  # fmt: skip
    manifest = Manifest(
        schema=SCHEMA,
        opset=OPSET,
        ir_version=IR_VERSION,
        files={},
        graphs={
            name: GraphEntry(f"graphs/{name}.onnx", None, (x,), (y,), {"y": 1e-7}, 1e-4, ("stroke_marker",))
            for name in GRAPHS
        },
        models={"stroke_marker": "1"},
        settings={"pen": setting},
        brushes={"pen": BrushFacts("marker", 4, {}, StrokeTiming(2.0, 5.0), None, picks_up=False, has_gain=False)},
        encoder=EncoderFacts(16, 8, 1, words),
        goal=GoalFacts(16, 4, 2, 0.8, (0.9, 0.5, 0.0), 1.0, "sample", "trailing", 0, 2, 1.0, 5.0, words, None),
        styles={},
        clays={},
        sculpting={},
        hands={},
        hand_planner=HAND_PLANNER,
    )
    for name, data in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    (folder / MANIFEST).write_text(json.dumps(to_plain(manifest)))
    relist(folder)
    return folder


def add_graphs(folder: Path, texts: Mapping[str, str], made_of: str) -> None:
    """Replace graphs by others in ONNX's text form, then `relist` the bundle."""
    graphs = json.loads((folder / MANIFEST).read_text())["graphs"]
    for name, text in texts.items():
        model = parse_model(f'<ir_version: {IR_VERSION}, opset_import: ["": {OPSET}]> {name} {text}')
        onnx.checker.check_model(model)
        (folder / "graphs" / f"{name}.onnx").write_bytes(model.SerializeToString())
        inputs, outputs = (_ports(values) for values in (model.graph.input, model.graph.output))
        parity = {port.name: 0.0 for port in outputs}
        graphs[name] = to_plain(GraphEntry(f"graphs/{name}.onnx", None, inputs, outputs, parity, 1e-4, (made_of,)))
    change(folder, graphs=graphs)


def numbers(values: ArrayLike) -> str:
    """Numbers in ONNX's text form."""
    return ", ".join(f"{float(value):.8f}" for value in np.asarray(values).ravel())


def _ports(values: Sequence[onnx.ValueInfoProto]) -> tuple[Port, ...]:
    ports = []
    for value in values:
        kind = value.type.tensor_type
        shape = tuple(size.dim_param or size.dim_value for size in kind.shape.dim)
        ports.append(Port(value.name, shape, "int64" if kind.elem_type == TensorProto.INT64 else "float32", "1"))
    return tuple(ports)


def relist(folder: Path) -> None:
    """Update the manifest to the files that exist, as careful tampering would."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.name != MANIFEST]
    change(folder, files={str(f.relative_to(folder)): to_plain(entry_of(f)) for f in files})


def entry_of(file: Path) -> FileEntry:
    """The manifest entry of a file."""
    data = file.read_bytes()
    return FileEntry(len(data), hashlib.sha256(data).hexdigest())


def change(folder: Path, **entries: Any) -> None:
    """Change entries of the manifest."""
    manifest = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps(manifest | entries))
