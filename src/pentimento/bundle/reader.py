"""Opening a bundle: everything that execution needs, in one folder that is checked completely before it is used.

``manifest.json`` lists every file with its size and SHA-256. ``open_bundle`` reads each file once, compares it, and
keeps the bytes that it compared. Graphs are opened from those bytes, so that no file can be exchanged in between.
Without a known hash of the manifest (``Bundle.digest``) the check shows completeness, not origin.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Final, NoReturn

from pentimento.bundle.manifest import ALIGNED_BYTES, FileEntry, GraphEntry, Manifest, Setting
from pentimento.bundle.onnx_header import Header, read_header
from pentimento.bundle.vocabulary import Vocabulary, read_vocabulary
from pentimento.contracts.codec import from_plain
from pentimento.contracts.errors import ConfigError, ContractError, PentimentoError
from pentimento.control.safety import SafetyEnvelope, envelope_for
from pentimento.planning.pushes.analytic.correction import Correction, correction_from
from pentimento.planning.pushes.places import PlaceModel, place_model_from
from pentimento.planning.strokes.latent import StyleDecoder, decoder_from
from pentimento.robots.tools import Tool, load_tool

SCHEMA: Final = 10
MANIFEST: Final = "manifest.json"
OPSETS: Final = (18, 20)
"""First and last operator set that is supported."""
IR_VERSIONS: Final = (8, 10)
MAX_FILE_BYTES: Final = 2**31 - 1
"""Maximum size of a protocol buffer."""
MAX_WEIGHTS_BYTES: Final = 2**34
"""Maximum size of a file of graphs' tensors, which is no protocol buffer."""
MAX_TENSOR_BYTES: Final = 2**29
MAX_MANIFEST_BYTES: Final = 2**22

FILE_NAME: Final = re.compile(r"[a-z0-9_][a-z0-9_.-]*(/[a-z0-9_][a-z0-9_.-]*)*")
"""What a file of a bundle may be called."""


class BundleError(PentimentoError):
    """A bundle differs from its manifest, or this version does not support it. Nothing of it was used."""


@dataclass(frozen=True, eq=False)
class Bundle:
    """A checked bundle."""

    folder: Path
    digest: str
    """SHA-256 of the manifest; it identifies the bundle."""
    manifest: Manifest
    tools: Mapping[str, Tool]
    """By setting."""
    contents: Mapping[str, bytes]
    """Checked bytes by file."""
    vocabulary: Vocabulary | None
    """What the goal planner was taught; None for one that knows all words."""
    hands: Mapping[str, StyleDecoder]
    """Handwriting styles by the writer's name."""
    corrections: Mapping[str, Correction]
    """Of push models, by the model's name; none where a model has no correction."""
    places: Mapping[str, PlaceModel] = field(default_factory=dict)
    """Place models by the name of the push model beside them; none where no pellets were collected."""

    def graph(self, name: str) -> bytes:
        """A graph's checked bytes.

        Raises:
            BundleError: the bundle has none of that name.
        """
        if name not in self.manifest.graphs:
            raise BundleError(f"The bundle has no graph {name!r}; it has {', '.join(sorted(self.manifest.graphs))}.")
        return self.contents[self.manifest.graphs[name].file]

    def weights(self, name: str) -> Mapping[str, bytes]:
        """The checked bytes of a graph's tensors in other files, by the name that the graph calls the file."""
        file = self.manifest.graphs[name].weights
        return {} if file is None else {PurePosixPath(file).name: self.contents[file]}

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

    def hand(self, name: str) -> StyleDecoder:
        """A person's handwriting style.

        Raises:
            BundleError: the bundle has none of that name.
        """
        if not self.hands:
            raise BundleError(
                f"The bundle has no hands, so nothing can be drawn in the hand {name!r}; write it with deploy --hands, "
                "or leave the hand out."
            )
        if name not in self.hands:
            raise BundleError(f"The bundle has no hand {name!r}; it has {', '.join(sorted(self.hands))}.")
        return self.hands[name]


def open_bundle(folder: Path, digest: str | None = None, local: Mapping[str, SafetyEnvelope] | None = None) -> Bundle:
    """Check a bundle and load it.

    Args:
        digest: the expected SHA-256 of the manifest, if it is known.
        local: by setting, an envelope that the bundle's must not exceed.

    Raises:
        BundleError: something differs from the manifest, or is not supported. No graph was opened.
    """
    folder = Path(folder)
    if not (folder / MANIFEST).exists():
        raise BundleError(f"{folder} is no bundle; `make repro` writes one into models/bundle (profile quick: none).")
    text = _read(folder, MANIFEST, MAX_MANIFEST_BYTES)
    found = hashlib.sha256(text).hexdigest()
    if digest is not None and digest != found:
        _refuse(folder, f"its manifest has the SHA-256 {found}, not {digest}: it is another bundle")
    manifest = _manifest(folder, text)
    _check_listing(folder, manifest)
    weights = {graph.weights for graph in manifest.graphs.values()}
    contents = {
        name: _checked_file(folder, name, entry, MAX_WEIGHTS_BYTES if name in weights else MAX_FILE_BYTES)
        for name, entry in sorted(manifest.files.items())
    }
    headers = {
        name: _checked_header(folder, name, graph, manifest, contents)
        for name, graph in sorted(manifest.graphs.items())
    }
    _check_weights(folder, headers, manifest, contents)
    tools = {name: _checked_tool(folder, name, setting, manifest) for name, setting in manifest.settings.items()}
    for name, setting in manifest.settings.items():
        wider = setting.envelope.wider_than((local or {}).get(name, setting.envelope))
        if wider:
            _refuse(folder, f"the safety envelope of {name} is wider than this robot's own in {', '.join(wider)}")
    _check_parts(folder, manifest)
    vocabulary, hands = _vocabulary(folder, manifest, contents), _hands(folder, manifest, contents)
    corrections = _corrections(folder, manifest, contents)
    places = _places(folder, manifest, contents)
    return Bundle(folder, found, manifest, tools, contents, vocabulary, hands, corrections, places)


def _manifest(folder: Path, text: bytes) -> Manifest:
    try:
        plain = json.loads(text, object_pairs_hook=_once, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        _refuse(folder, f"its manifest is not plain JSON ({error})")
    if not isinstance(plain, dict) or plain.get("schema") != SCHEMA:
        schema = plain.get("schema") if isinstance(plain, dict) else None
        _refuse(
            folder,
            f"its manifest is of schema {schema!r} and this version reads {SCHEMA}; "
            "write the bundle again with the stage deploy",
        )
    for name in plain.get("files", ()):
        if not FILE_NAME.fullmatch(name) or name == MANIFEST:
            _refuse(folder, f"its manifest names a file {name!r}; names are plain and lie within the bundle")
    try:
        return from_plain(Manifest, plain, "manifest")
    except (ContractError, ConfigError) as error:
        raise BundleError(f"The bundle {folder} is refused: {error}") from error


def _check_listing(folder: Path, manifest: Manifest) -> None:
    """Refuse links, special files, files that are not listed, and missing files."""
    found = set(_entries(folder, ""))
    listed = {*manifest.files, MANIFEST}
    if found - listed:
        _refuse(folder, f"it holds {sorted(found - listed)[0]!r}, which its manifest does not list")
    if listed - found:
        _refuse(folder, f"{sorted(listed - found)[0]!r} is missing")


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


def _checked_file(folder: Path, name: str, entry: FileEntry, limit: int) -> bytes:
    if not 0 <= entry.bytes <= limit:
        _refuse(folder, f"{name!r} is listed with {entry.bytes} bytes; {limit} are the maximum")
    data = _read(folder, name, entry.bytes)
    if len(data) != entry.bytes or hashlib.sha256(data).hexdigest() != entry.sha256:
        _refuse(folder, f"{name!r} is not the file that its manifest lists: its SHA-256 or size is another")
    return data


def _read(folder: Path, name: str, limit: int) -> bytes:
    """A file's content, at most one byte more than the limit."""
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
        if status.st_size > limit:
            _refuse(folder, f"{name!r} has {status.st_size} bytes; at most {limit} are allowed")
        return file.read(limit + 1)


def _checked_header(
    folder: Path, name: str, graph: GraphEntry, manifest: Manifest, contents: Mapping[str, bytes]
) -> Header:
    if graph.file not in contents:
        _refuse(folder, f"the manifest names the file {graph.file!r} for the graph {name} and does not list it")
    try:
        header = read_header(contents[graph.file])
    except ContractError as error:
        raise BundleError(f"The bundle {folder} is refused: the graph {name} in {graph.file!r}: {error}") from error
    defect = _external_defect(header, graph, manifest) or _defect(header, graph, manifest)
    if defect:
        _refuse(folder, f"the graph {name} {defect}")
    return header


def _defect(header: Header, graph: GraphEntry, manifest: Manifest) -> str | None:
    """How a graph differs from its manifest entry, or why it is not supported."""
    opset = header.opsets.get("", header.opsets.get("ai.onnx", 0))
    if len(header.opsets) != 1 or opset != manifest.opset or not OPSETS[0] <= opset <= OPSETS[1]:
        return f"uses the operator sets {header.opsets}; the manifest names version {manifest.opset} of ONNX's own"
    if header.ir_version != manifest.ir_version or not IR_VERSIONS[0] <= header.ir_version <= IR_VERSIONS[1]:
        return f"is of the IR version {header.ir_version}; the manifest names {manifest.ir_version}"
    if header.largest_tensor_bytes > MAX_TENSOR_BYTES:
        return f"has a tensor of {header.largest_tensor_bytes} bytes; {MAX_TENSOR_BYTES} are the maximum"
    for what, found, listed in (("inputs", header.inputs, graph.inputs), ("outputs", header.outputs, graph.outputs)):
        shapes = [(port.name, port.shape) for port in listed]
        if [*found.items()] != shapes:
            return f"has the {what} {found}, and its manifest says {dict(shapes)}"
    compared = set(graph.parity) == {port.name for port in graph.outputs}
    if not compared or not all(0 <= error <= graph.tolerance for error in graph.parity.values()):
        return f"differs from its model by {graph.parity}; {graph.tolerance} is the tolerance"
    return None


def _external_defect(header: Header, graph: GraphEntry, manifest: Manifest) -> str | None:
    """Why tensors in other files do not each lie in the listed one."""
    if graph.weights is None:
        if header.external:
            return f"keeps tensors in {header.external[0].location!r}, and its manifest says that it keeps none"
        return None
    if graph.weights not in manifest.files or graph.weights in {each.file for each in manifest.graphs.values()}:
        return f"has its tensors in {graph.weights!r}, which its manifest does not list as a file of tensors"
    for tensor in header.external:
        if tensor.location != _beside(graph):
            return f"keeps tensors in {tensor.location!r}, and its manifest says in {graph.weights!r}"
    if not header.external:
        return f"keeps no tensors in {graph.weights!r}, and its manifest says that it does"
    if len({(tensor.offset, tensor.length) for tensor in header.external}) != len(header.external):
        return f"has two tensors at the same place in {graph.weights!r}"
    return None


def _check_weights(
    folder: Path, headers: Mapping[str, Header], manifest: Manifest, contents: Mapping[str, bytes]
) -> None:
    """Refuse files of tensors that hold anything else, or tensors that overlap without being the same one."""
    places: dict[str, set[tuple[int, int]]] = {}
    for name, graph in manifest.graphs.items():
        if graph.weights is not None:
            of_graph = {(tensor.offset, tensor.length) for tensor in headers[name].external}
            places[graph.weights] = places.get(graph.weights, set()) | of_graph
    for file, ranges in sorted(places.items()):
        data, at = contents[file], 0
        end = max(offset + length for offset, length in ranges)
        if end != len(data):
            _refuse(folder, f"its graphs have tensors up to byte {end} of {file!r}, which has {len(data)}")
        for offset, length in sorted(ranges):
            if offset < at:
                _refuse(folder, f"its graphs have tensors in {file!r} that overlap")
            if offset - at >= ALIGNED_BYTES or data[at:offset].strip(b"\0"):
                _refuse(folder, f"{file!r} has bytes from {at} to {offset} that are no tensor's")
            at = offset + length


def _beside(graph: GraphEntry) -> str | None:
    """What a graph calls its file of tensors; None where this lies in another folder."""
    if graph.weights is None or PurePosixPath(graph.weights).parent != PurePosixPath(graph.file).parent:
        return None
    return PurePosixPath(graph.weights).name


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


def _vocabulary(folder: Path, manifest: Manifest, contents: Mapping[str, bytes]) -> Vocabulary | None:
    name = manifest.goal.nouns
    try:
        return None if name is None else read_vocabulary(contents[name], name)
    except ConfigError as error:
        raise BundleError(f"The bundle {folder} is refused: {error}") from error


def _hands(folder: Path, manifest: Manifest, contents: Mapping[str, bytes]) -> dict[str, StyleDecoder]:
    try:
        hands = {name: decoder_from(contents[facts.file], facts.file) for name, facts in manifest.hands.items()}
    except ContractError as error:
        raise BundleError(f"The bundle {folder} is refused: {error}") from error
    for name, decoder in hands.items():
        if decoder.hand != name:
            _refuse(folder, f"the hand {name} is in its file that of {decoder.hand!r}")
        for setting, entry in manifest.settings.items():
            if entry.path_brush is None:
                _refuse(folder, f"it has the hand {name}, and the setting {setting} no brush for it")
            points = manifest.brushes[entry.path_brush].path_points
            if decoder.points != points:
                _refuse(
                    folder,
                    f"the hand {name} has paths of {decoder.points} points, and the brush {entry.path_brush} of "
                    f"{points}: train hands and deploy brushes at the same number",
                )
    return hands


def _corrections(folder: Path, manifest: Manifest, contents: Mapping[str, bytes]) -> dict[str, Correction]:
    files = {name: clay.correction for name, clay in manifest.clays.items() if clay.correction is not None}
    try:
        return {name: correction_from(contents[file], file) for name, file in files.items()}
    except ContractError as error:
        raise BundleError(f"The bundle {folder} is refused: {error}") from error


def _places(folder: Path, manifest: Manifest, contents: Mapping[str, bytes]) -> dict[str, PlaceModel]:
    files = {name: clay.places for name, clay in manifest.clays.items() if clay.places is not None}
    for name, settings in manifest.sculpting.items():
        if settings.feeder is not None and name not in files:
            _refuse(folder, f"{name} is sculpted with the feeder {settings.feeder}, and there is no place model of it")
    try:
        return {name: place_model_from(contents[file], file) for name, file in files.items()}
    except ContractError as error:
        raise BundleError(f"The bundle {folder} is refused: {error}") from error


def _check_parts(folder: Path, manifest: Manifest) -> None:
    """Refuse a manifest that refers to graphs, files, brushes or models that it does not list."""
    graphs = {"semantic", "text", "caption", "goal_text", "goal_encode", "goal_denoise", "goal_decode"}
    for name, brush in manifest.brushes.items():
        graphs |= {f"{name}_marks", f"{name}_pull"} | ({f"{name}_gain"} if brush.has_gain else set())
    for name in manifest.styles:
        graphs |= {f"{name}_features", f"{name}_pull"}
    for name, clay in manifest.clays.items():
        if clay.members < 1:
            _refuse(folder, f"the push model {name} has {clay.members} networks")
        graphs |= {f"{name}_{member}_{of}" for member in range(clay.members) for of in ("after", "pull")}
    words = (manifest.encoder.words, manifest.goal.words)
    files = {file for entry in words for file in (entry.vocabulary, entry.merges)}
    files |= set() if manifest.goal.nouns is None else {manifest.goal.nouns}
    files |= {hand.file for hand in manifest.hands.values()}
    files |= {f"end_effectors/{clay.end_effector}.toml" for clay in manifest.clays.values()}
    files |= {clay.correction for clay in manifest.clays.values() if clay.correction is not None}
    files |= {clay.places for clay in manifest.clays.values() if clay.places is not None}
    feeders = (settings.feeder for settings in manifest.sculpting.values())
    files |= {f"feeders/{feeder}.toml" for feeder in feeders if feeder is not None}
    missing = [*sorted(graphs - set(manifest.graphs)), *sorted(files - set(manifest.files))]
    missing += [setting.brush for setting in manifest.settings.values() if setting.brush not in manifest.brushes]
    paths = {setting.path_brush for setting in manifest.settings.values() if setting.path_brush is not None}
    missing += sorted(paths - set(manifest.brushes))
    missing += sorted(set(manifest.clays) ^ set(manifest.sculpting))
    missing += [model for graph in manifest.graphs.values() for model in graph.models if model not in manifest.models]
    if missing:
        _refuse(folder, f"its manifest refers to {missing[0]!r} and does not list it")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entries = dict(pairs)
    if len(entries) != len(pairs):
        raise ValueError("a key occurs twice")
    return entries


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number")


def _refuse(folder: Path, reason: str) -> NoReturn:
    raise BundleError(f"The bundle {folder} is refused: {reason}.")
