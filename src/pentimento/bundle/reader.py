"""The bundle: everything that execution needs, in one folder, checked whole before any of it is used.

``manifest.json`` lists every file with its size and SHA-256. ``open_bundle`` reads each file once, compares, and keeps
what it compared: graphs are opened from those very bytes, so that nobody can exchange them in between. It is as good
as the manifest is: whose hash (``Bundle.digest``) is not known beforehand, that one has only been found complete.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NoReturn

from pentimento.bundle.onnx_header import Header, read_header
from pentimento.bundle.push_graphs import ClayFacts
from pentimento.contracts.codec import from_plain
from pentimento.contracts.errors import ConfigError, ContractError, PentimentoError
from pentimento.control.safety import SafetyEnvelope, envelope_for
from pentimento.planning.strokes.brush import LoopTiming, Span
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.robots.tools import Tool, load_tool

SCHEMA: Final = 1
MANIFEST: Final = "manifest.json"
OPSETS: Final = (18, 20)
"""From and to: operator sets that are known here."""
IR_VERSIONS: Final = (8, 10)
LARGEST_FILE_BYTES: Final = 2**31 - 1
"""As much as a protocol buffer can be."""
LARGEST_TENSOR_BYTES: Final = 2**29
LARGEST_MANIFEST_BYTES: Final = 2**22

_NAME = re.compile(r"[a-z0-9_][a-z0-9_.-]*(/[a-z0-9_][a-z0-9_.-]*)*")


class BundleError(PentimentoError):
    """A bundle is not what its manifest says, or is none that this version runs. Nothing of it was used."""


@dataclass(frozen=True)
class FileEntry:
    """A file of the bundle."""

    bytes: int
    sha256: str


@dataclass(frozen=True)
class Port:
    """An input or output of a graph."""

    name: str
    shape: tuple[int | str, ...]
    """Sizes; a name stands for one that is open."""
    type: Literal["float32", "int64"]
    unit: str
    """Unit, frame or range, in words."""


@dataclass(frozen=True)
class GraphEntry:
    """A graph of the bundle, and how well it agrees with what it was exported from."""

    file: str
    inputs: tuple[Port, ...]
    """In their order."""
    outputs: tuple[Port, ...]
    parity: dict[str, float]
    """Of each output: the norm of the difference from PyTorch's over the norm of PyTorch's, the largest of several."""
    tolerance: float
    """``parity`` was found to be at most this."""
    models: tuple[str, ...]
    """Which of the manifest's models it came from."""


@dataclass(frozen=True)
class BrushFacts:
    """A stroke model, beside its graphs ``<name>_marks``, ``<name>_pull`` and, where it has one, ``<name>_gain``."""

    tool: str
    path_points: int
    fitted: dict[str, Span]
    timing: LoopTiming
    picks_up: bool
    """Whether it carries wet paint along: marks have a pickup."""
    has_gain: bool
    """Whether it says by what the camera multiplies light."""


@dataclass(frozen=True)
class WordsFacts:
    """A tokenizer."""

    vocabulary: str
    """Its files."""
    merges: str
    tokens: int
    """Of a caption: what is longer is cut."""


@dataclass(frozen=True)
class EncoderFacts:
    """The text-image encoder, beside the graphs ``semantic``, ``text`` and ``caption``."""

    image_px: int
    """Side of the pictures that it sees."""
    embedding: int
    views: int
    """Of a picture, moved at random, beside the plain one."""
    words: WordsFacts


@dataclass(frozen=True)
class GoalFacts:
    """The goal planner, beside the graphs ``goal_text``, ``goal_encode``, ``goal_denoise`` and ``goal_decode``."""

    side_px: int
    """Of the pictures that it was trained on."""
    latent_channels: int
    latent_step_px: int
    """Side of the square of the picture that a place of the latents stands for."""
    scaling: float
    """Of the latents that are sampled."""
    alphas_cumprod: tuple[float, ...]
    final_alpha: float
    prediction: Literal["epsilon", "v_prediction", "sample"]
    spacing: Literal["trailing", "leading"]
    offset: int
    steps: int
    image_guidance: float
    text_guidance: float
    words: WordsFacts


@dataclass(frozen=True)
class StyleFacts:
    """Local features of pictures of one size, beside the graphs ``<name>_features`` and ``<name>_pull``."""

    height_px: int
    width_px: int
    cells: int


@dataclass(frozen=True)
class Setting:
    """A tool before a canvas, and how it paints there."""

    tool: str
    """Its file."""
    brush: str
    """Which of the manifest's brushes."""
    canvas_m: tuple[float, float]
    strokes: int
    batch: int
    """Strokes between two photographs."""
    planner: PlannerConfig
    envelope: SafetyEnvelope


@dataclass(frozen=True)
class Manifest:
    """What a bundle says of itself."""

    schema: int
    opset: int
    ir_version: int
    files: dict[str, FileEntry]
    graphs: dict[str, GraphEntry]
    models: dict[str, str]
    """By name, the digest by which the pipeline knows the model's folder."""
    settings: dict[str, Setting]
    brushes: dict[str, BrushFacts]
    encoder: EncoderFacts
    goal: GoalFacts
    styles: dict[str, StyleFacts]
    clays: dict[str, ClayFacts]
    """Push models by the names of their graphs; each one's end-effector is in ``end_effectors/<name>.toml``."""


@dataclass(frozen=True, eq=False)
class Bundle:
    """A bundle that was checked."""

    folder: Path
    digest: str
    """SHA-256 of the manifest: who knows it beforehand knows the bundle."""
    manifest: Manifest
    tools: Mapping[str, Tool]
    """By setting."""
    contents: Mapping[str, bytes]
    """Of each file, as it was checked."""

    def graph(self, name: str) -> bytes:
        """A graph's checked bytes.

        Raises:
            BundleError: the bundle has none of that name.
        """
        if name not in self.manifest.graphs:
            raise BundleError(f"The bundle has no graph {name!r}; it has {', '.join(sorted(self.manifest.graphs))}.")
        return self.contents[self.manifest.graphs[name].file]

    def setting(self, name: str) -> Setting:
        """A setting.

        Raises:
            BundleError: the bundle has none of that name.
        """
        if name not in self.manifest.settings:
            raise BundleError(
                f"The bundle has no setting {name!r}; it has {', '.join(sorted(self.manifest.settings))}."
            )
        return self.manifest.settings[name]


def open_bundle(folder: Path, digest: str | None = None, local: Mapping[str, SafetyEnvelope] | None = None) -> Bundle:
    """Check a bundle and hold it.

    Args:
        digest: the manifest's SHA-256, where it is known; then it must be that.
        local: for settings by name an envelope that the bundle's must not be wider than.

    Raises:
        BundleError: anything is not as the manifest says, or not as this version knows it. No graph was opened.
    """
    folder = Path(folder)
    text = _read(folder, MANIFEST, LARGEST_MANIFEST_BYTES)
    found = hashlib.sha256(text).hexdigest()
    if digest is not None and digest != found:
        _refuse(folder, f"its manifest has the SHA-256 {found}, not {digest}: it is another bundle")
    manifest = _manifest(folder, text)
    _check_listing(folder, manifest)
    contents = {name: _checked_file(folder, name, entry) for name, entry in sorted(manifest.files.items())}
    for name, graph in sorted(manifest.graphs.items()):
        _check_graph(folder, name, graph, manifest, contents)
    tools = {name: _checked_tool(folder, name, setting, manifest) for name, setting in manifest.settings.items()}
    for name, setting in manifest.settings.items():
        wider = setting.envelope.wider_than((local or {}).get(name, setting.envelope))
        if wider:
            _refuse(folder, f"the safety envelope of {name} is wider than this robot's own in {', '.join(wider)}")
    _check_parts(folder, manifest)
    return Bundle(folder, found, manifest, tools, contents)


def _manifest(folder: Path, text: bytes) -> Manifest:
    try:
        plain = json.loads(text, object_pairs_hook=_once, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        _refuse(folder, f"its manifest is not plain JSON ({error})")
    if not isinstance(plain, dict) or plain.get("schema") != SCHEMA:
        schema = plain.get("schema") if isinstance(plain, dict) else None
        _refuse(folder, f"its manifest is of schema {schema!r} and this version reads {SCHEMA}")
    for name in plain.get("files", ()):
        if not _NAME.fullmatch(name) or name == MANIFEST:
            _refuse(folder, f"its manifest names a file {name!r}; names are plain and lie within the bundle")
    try:
        return from_plain(Manifest, plain, "manifest")
    except (ContractError, ConfigError) as error:
        raise BundleError(f"The bundle {folder} is refused: {error}") from error


def _check_listing(folder: Path, manifest: Manifest) -> None:
    """No link, no special file, none that is not listed and none that is missing."""
    there = set(_entries(folder, ""))
    listed = {*manifest.files, MANIFEST}
    if there - listed:
        _refuse(folder, f"it holds {sorted(there - listed)[0]!r}, which its manifest does not list")
    if listed - there:
        _refuse(folder, f"{sorted(listed - there)[0]!r} is missing")


def _entries(folder: Path, inside: str) -> Iterator[str]:
    with os.scandir(folder / inside) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            name = f"{inside}{entry.name}"
            if entry.is_symlink():
                _refuse(folder, f"{name!r} is a link")
            if entry.is_dir():
                yield from _entries(folder, f"{name}/")
            elif entry.is_file():
                yield name
            else:
                _refuse(folder, f"{name!r} is neither a file nor a folder")


def _checked_file(folder: Path, name: str, entry: FileEntry) -> bytes:
    if not 0 <= entry.bytes <= LARGEST_FILE_BYTES:
        _refuse(folder, f"{name!r} is listed with {entry.bytes} bytes; {LARGEST_FILE_BYTES} are the most")
    data = _read(folder, name, entry.bytes)
    if len(data) != entry.bytes or hashlib.sha256(data).hexdigest() != entry.sha256:
        _refuse(folder, f"{name!r} is not the file that its manifest lists: its SHA-256 or size is another")
    return data


def _read(folder: Path, name: str, most: int) -> bytes:
    """A file's content; of one that is larger, one byte more than the most."""
    try:
        handle = os.open(folder / name, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError as error:
        _refuse(folder, f"{name!r} cannot be opened as a file ({error.strerror})")
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            _refuse(folder, f"{name!r} is not a file")
        if status.st_nlink != 1:
            _refuse(folder, f"{name!r} is known by {status.st_nlink} names (hard links); copy the bundle")
        if status.st_size > most:
            _refuse(folder, f"{name!r} has {status.st_size} bytes where at most {most} belong")
        return file.read(most + 1)


def _check_graph(folder: Path, name: str, graph: GraphEntry, manifest: Manifest, contents: Mapping[str, bytes]) -> None:
    if graph.file not in contents:
        _refuse(folder, f"the graph {name} is said to be in {graph.file!r}, which its manifest does not list")
    try:
        header = read_header(contents[graph.file])
    except ContractError as error:
        raise BundleError(f"The bundle {folder} is refused: the graph {name} in {graph.file!r}: {error}") from error
    wrong = _wrong(header, graph, manifest)
    if wrong:
        _refuse(folder, f"the graph {name} {wrong}")


def _wrong(header: Header, graph: GraphEntry, manifest: Manifest) -> str | None:
    """What is wrong with a graph."""
    opset = header.opsets.get("", header.opsets.get("ai.onnx", 0))
    if header.external_data:
        return "keeps tensors in other files"
    if len(header.opsets) != 1 or opset != manifest.opset or not OPSETS[0] <= opset <= OPSETS[1]:
        return f"uses the operator sets {header.opsets}; ONNX's own of version {manifest.opset} was announced"
    if header.ir_version != manifest.ir_version or not IR_VERSIONS[0] <= header.ir_version <= IR_VERSIONS[1]:
        return f"is of the IR version {header.ir_version}; {manifest.ir_version} was announced"
    if header.largest_tensor_bytes > LARGEST_TENSOR_BYTES:
        return f"has a tensor of {header.largest_tensor_bytes} bytes; {LARGEST_TENSOR_BYTES} are the most"
    for what, found, listed in (("inputs", header.inputs, graph.inputs), ("outputs", header.outputs, graph.outputs)):
        shapes = [(port.name, port.shape) for port in listed]
        if [*found.items()] != shapes:
            return f"has the {what} {found}, and its manifest says {dict(shapes)}"
    compared = set(graph.parity) == {port.name for port in graph.outputs}
    if not compared or not all(0 <= error <= graph.tolerance for error in graph.parity.values()):
        return f"differs from what it came from by {graph.parity}, of which {graph.tolerance} was allowed"
    return None


def _checked_tool(folder: Path, name: str, setting: Setting, manifest: Manifest) -> Tool:
    if setting.tool not in manifest.files:
        _refuse(folder, f"the setting {name} names the tool {setting.tool!r}, which its manifest does not list")
    try:
        tool = load_tool(folder / setting.tool)
    except ConfigError as error:
        raise BundleError(f"The bundle {folder} is refused: {error}") from error
    if setting.envelope != envelope_for(tool, setting.canvas_m):
        _refuse(
            folder, f"the safety envelope of {name} is not that of its tool before a canvas of {setting.canvas_m} m"
        )
    return tool


def _check_parts(folder: Path, manifest: Manifest) -> None:
    """What settings, brushes and networks need is there."""
    graphs = {"semantic", "text", "caption", "goal_text", "goal_encode", "goal_denoise", "goal_decode"}
    for name, brush in manifest.brushes.items():
        graphs |= {f"{name}_marks", f"{name}_pull"} | ({f"{name}_gain"} if brush.has_gain else set())
    for name in manifest.styles:
        graphs |= {f"{name}_features", f"{name}_pull"}
    for name in manifest.clays:
        graphs |= {f"{name}_after", f"{name}_pull"}
    words = (manifest.encoder.words, manifest.goal.words)
    files = {file for entry in words for file in (entry.vocabulary, entry.merges)}
    files |= {f"end_effectors/{clay.end_effector}.toml" for clay in manifest.clays.values()}
    lacking = [*sorted(graphs - set(manifest.graphs)), *sorted(files - set(manifest.files))]
    lacking += [setting.brush for setting in manifest.settings.values() if setting.brush not in manifest.brushes]
    lacking += [model for graph in manifest.graphs.values() for model in graph.models if model not in manifest.models]
    if lacking:
        _refuse(folder, f"its manifest speaks of {lacking[0]!r} and does not have it")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entries = dict(pairs)
    if len(entries) != len(pairs):
        raise ValueError("a key stands twice")
    return entries


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _refuse(folder: Path, reason: str) -> NoReturn:
    raise BundleError(f"The bundle {folder} is refused: {reason}.")
