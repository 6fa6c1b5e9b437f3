"""A bundle is opened when it agrees with its manifest, and refused otherwise."""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import numpy_helper

from pentimento.bundle.graphs import Graphs
from pentimento.bundle.manifest import Manifest
from pentimento.bundle.reader import MANIFEST, MAX_FILE_BYTES, BundleError, open_bundle
from pentimento.contracts.codec import from_plain, to_plain
from pentimento.contracts.errors import ConfigError
from pentimento.control.safety import envelope_for
from pentimento.planning.strokes.latent import decoder_bytes
from pentimento.robots.tools import load_tool
from pipelines._imports import ROOT, imported_names
from tests.bundle.small_hands import HAND_POINTS, small_hand
from tests.bundle.tiny_bundle import CANVAS_M, GRAPHS, change, graph, relist, write_tiny_bundle
from tests.control.painting_bundle import small_vocabulary, write_painting_bundle
from tests.control.sculpting_bundle import SETTINGS

SEMANTIC = "graphs/semantic.onnx"
SHARED = "graphs/semantic.weights"
ONES, TWOS = np.ones(2, np.float32).tobytes(), np.full(2, 2, np.float32).tobytes()


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    return write_tiny_bundle(tmp_path / "bundle")


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("kept") / "bundle")


def put(folder: Path, model: onnx.ModelProto) -> None:
    """Replace a graph and list it in the manifest."""
    (folder / SEMANTIC).write_bytes(model.SerializeToString())
    relist(folder)


def test_open_bundle_keeps_the_checked_bytes(bundle: Path) -> None:
    opened = open_bundle(bundle)
    assert opened.digest == hashlib.sha256((bundle / MANIFEST).read_bytes()).hexdigest()
    assert opened.tools == {"pen": load_tool("marker")}
    assert opened.setting("pen").envelope == envelope_for(load_tool("marker"), CANVAS_M)
    checked = opened.graph("semantic")
    (bundle / SEMANTIC).write_bytes(b"exchanged after the check")
    assert opened.graph("semantic") == checked == graph().SerializeToString()


def test_manifest_round_trip(bundle: Path) -> None:
    manifest = open_bundle(bundle).manifest
    assert from_plain(Manifest, json.loads(json.dumps(to_plain(manifest))), "manifest") == manifest


def test_bundle_names_known_graphs_and_settings(bundle: Path) -> None:
    opened = open_bundle(bundle)
    with pytest.raises(BundleError, match=r"no graph 'push'.*semantic"):
        opened.graph("push")
    with pytest.raises(BundleError, match=r"no setting 'oil'.*pen"):
        opened.setting("oil")


def test_open_bundle_rejects_another_digest(bundle: Path) -> None:
    digest = open_bundle(bundle).digest
    assert open_bundle(bundle, digest).digest == digest
    change(bundle, models={"stroke_marker": "2"})
    open_bundle(bundle)
    with pytest.raises(BundleError, match="another bundle"):
        open_bundle(bundle, digest)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_open_bundle_rejects_any_changed_byte(kept: Path, data: st.DataObject) -> None:
    names = sorted(json.loads((kept / MANIFEST).read_text())["files"])
    file = kept / data.draw(st.sampled_from(names))
    whole = file.read_bytes()
    at, flip = data.draw(st.integers(0, len(whole) - 1)), data.draw(st.integers(1, 255))
    file.write_bytes(whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :])
    try:
        with pytest.raises(BundleError, match="SHA-256 or size is another"):
            open_bundle(kept)
    finally:
        file.write_bytes(whole)
    open_bundle(kept)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 40), st.booleans())
def test_open_bundle_rejects_a_file_of_another_length(kept: Path, count: int, longer: bool) -> None:
    file = kept / SEMANTIC
    whole = file.read_bytes()
    file.write_bytes(whole + bytes(count) if longer else whole[:-count])
    try:
        with pytest.raises(BundleError, match=r"bytes; at most|SHA-256 or size"):
            open_bundle(kept)
    finally:
        file.write_bytes(whole)


def _extra(folder: Path) -> None:
    (folder / "graphs" / "more.onnx").write_bytes(graph().SerializeToString())


def _extra_hidden(folder: Path) -> None:
    (folder / ".note").write_text("")


def _missing(folder: Path) -> None:
    (folder / "words" / "merges.txt").unlink()


def _link(folder: Path) -> None:
    (folder / SEMANTIC).replace(folder.parent / "outside.onnx")
    (folder / SEMANTIC).symlink_to(folder.parent / "outside.onnx")


def _linked_folder(folder: Path) -> None:
    shutil.move(folder / "graphs", folder.parent / "graphs")
    (folder / "graphs").symlink_to(folder.parent / "graphs")


def _linked_manifest(folder: Path) -> None:
    (folder / MANIFEST).replace(folder.parent / MANIFEST)
    (folder / MANIFEST).symlink_to(folder.parent / MANIFEST)


def _hard_link(folder: Path) -> None:
    os.link(folder / SEMANTIC, folder.parent / "outside.onnx")


def _pipe(folder: Path) -> None:
    os.mkfifo(folder / "graphs" / "pipe.onnx")


def _pipe_in_place(folder: Path) -> None:
    (folder / SEMANTIC).unlink()
    os.mkfifo(folder / SEMANTIC)


def _no_manifest(folder: Path) -> None:
    (folder / MANIFEST).unlink()


@pytest.mark.parametrize(
    ("tamper", "message"),
    [
        (_extra, "'graphs/more.onnx', which its manifest does not list"),
        (_extra_hidden, "'.note', which its manifest does not list"),
        (_missing, "'words/merges.txt' is missing"),
        (_link, "'graphs/semantic.onnx' is a link"),
        (_linked_folder, "'graphs' is a link"),
        (_linked_manifest, "'manifest.json' cannot be opened"),
        (_hard_link, "known by 2 names"),
        (_pipe, "neither a file nor a folder"),
        (_pipe_in_place, "neither a file nor a folder"),
        (_no_manifest, "is no bundle"),
    ],
)
def test_open_bundle_rejects_unlisted_missing_and_special_files(
    bundle: Path, tamper: Callable[[Path], None], message: str
) -> None:
    tamper(bundle)
    with pytest.raises(BundleError, match=message):
        open_bundle(bundle)


@pytest.mark.parametrize(
    "name",
    ["../secret.txt", "/etc/hostname", "graphs/../../secret.txt", "graphs\\semantic.onnx", "", ".", "./graphs/a.onnx",
     "graphs//a.onnx", "graphs/", "Graphs/A.onnx", "a\n", "manifest.json"],
)  # fmt: skip
def test_open_bundle_rejects_paths_outside_the_bundle(bundle: Path, name: str) -> None:
    (bundle.parent / "secret.txt").write_text("secret")
    files = json.loads((bundle / MANIFEST).read_text())["files"]
    change(bundle, files=files | {name: {"bytes": 6, "sha256": hashlib.sha256(b"secret").hexdigest()}})
    with pytest.raises(BundleError, match="lie within the bundle"):
        open_bundle(bundle)


def put_outside(
    bundle: Path,
    *,
    location: str = "semantic.weights",
    weights: str | None = "graphs/semantic.weights",
    offset: int = 0,
    more: bytes = b"",
) -> None:
    """Give the graph `semantic` its tensor in another file, and say so in the manifest."""
    model = graph()
    tensor = model.graph.initializer[0]
    (bundle / "graphs" / "semantic.weights").write_bytes(tensor.raw_data + more)
    move_out(tensor, location, offset)
    put(bundle, model)
    graphs = json.loads((bundle / MANIFEST).read_text())["graphs"]
    change(bundle, graphs=graphs | {"semantic": graphs["semantic"] | {"weights": weights}})


def move_out(tensor: onnx.TensorProto, location: str, offset: int) -> None:
    """Say that a tensor of 8 bytes lies in another file."""
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    for key, value in (("location", location), ("offset", offset), ("length", 8)):
        tensor.external_data.add(key=key, value=str(value))


def put_shared(bundle: Path, content: bytes = ONES, *, offset: int = 0, weights: str | None = SHARED) -> None:
    """Give `semantic` and `text` their tensors in one file; that of `text` lies at the offset."""
    put_outside(bundle)
    (bundle / SHARED).write_bytes(content)
    model = graph()
    move_out(model.graph.initializer[0], "semantic.weights", offset)
    (bundle / "graphs" / "text.onnx").write_bytes(model.SerializeToString())
    graphs = json.loads((bundle / MANIFEST).read_text())["graphs"]
    change(bundle, graphs=graphs | {"text": graphs["text"] | {"weights": weights}})
    relist(bundle)


def test_a_graph_with_its_tensors_in_a_listed_file_runs_from_the_checked_bytes(bundle: Path) -> None:
    put_outside(bundle)
    opened = open_bundle(bundle)
    (bundle / "graphs" / "semantic.weights").unlink()  # after the check, no file is opened
    (found,) = Graphs(opened)("semantic", np.array([[1, 2]], np.float32))
    np.testing.assert_array_equal(found, [[2, 3]])


@pytest.mark.parametrize("change_it", [lambda data: data[:-1], lambda data: data[:-1] + bytes([data[-1] ^ 1])])
def test_open_bundle_rejects_tampered_external_tensors(bundle: Path, change_it: Callable[[bytes], bytes]) -> None:
    put_outside(bundle)
    file = bundle / "graphs" / "semantic.weights"
    file.write_bytes(change_it(file.read_bytes()))
    with pytest.raises(BundleError, match=r"semantic\.weights' is not the file that its manifest lists"):
        open_bundle(bundle)


@pytest.mark.parametrize(
    ("outside", "sentence"),
    [
        ({"weights": None}, "keeps tensors in 'semantic.weights', and its manifest says that it keeps none"),
        ({"location": "../tools/marker.toml"}, "keeps tensors in '../tools/marker.toml'"),
        ({"location": "/etc/hostname"}, "keeps tensors in '/etc/hostname'"),
        ({"location": "marker.toml", "weights": "tools/marker.toml"}, "keeps tensors in 'marker.toml'"),
        ({"location": "text.onnx", "weights": "graphs/text.onnx"}, "does not list as a file of tensors"),
        ({"location": "no.weights", "weights": "graphs/no.weights"}, "does not list as a file of tensors"),
        ({"offset": 8}, "up to byte 16 of 'graphs/semantic.weights', which has 8"),
        ({"more": b"more"}, "up to byte 8 of 'graphs/semantic.weights', which has 12"),
    ],
)
def test_open_bundle_rejects_external_tensors_in_any_other_place(
    bundle: Path, outside: dict[str, Any], sentence: str
) -> None:
    put_outside(bundle, **outside)
    with pytest.raises(BundleError, match=sentence):
        open_bundle(bundle)


def test_open_bundle_rejects_a_file_of_tensors_that_no_tensor_lies_in(bundle: Path) -> None:
    put_outside(bundle)
    put(bundle, graph())
    with pytest.raises(BundleError, match=r"semantic keeps no tensors in 'graphs/semantic\.weights', and its manifest"):
        open_bundle(bundle)


@pytest.mark.parametrize(
    ("content", "offset", "one"), [(ONES, 0, 1.0), (ONES + TWOS, 8, 2.0), (ONES + bytes(56) + TWOS, 64, 2.0)]
)
def test_graphs_that_share_a_file_of_tensors_run_from_its_checked_bytes(
    bundle: Path, content: bytes, offset: int, one: float
) -> None:
    put_shared(bundle, content, offset=offset)
    opened = open_bundle(bundle)
    assert opened.weights("semantic")["semantic.weights"] is opened.weights("text")["semantic.weights"]  # read once
    (bundle / SHARED).unlink()
    graphs, given = Graphs(opened), np.array([[3, 4]], np.float32)
    np.testing.assert_array_equal(graphs("semantic", given)[0], given + 1)
    np.testing.assert_array_equal(graphs("text", given)[0], given + one)


@pytest.mark.parametrize("change_it", [lambda data: data[:-1], lambda data: data[:-1] + bytes([data[-1] ^ 1])])
def test_open_bundle_rejects_a_tampered_shared_file(bundle: Path, change_it: Callable[[bytes], bytes]) -> None:
    put_shared(bundle)
    (bundle / SHARED).write_bytes(change_it(ONES))
    with pytest.raises(BundleError, match=r"semantic\.weights' is not the file that its manifest lists"):
        open_bundle(bundle)


@pytest.mark.parametrize(
    ("shared", "sentence"),
    [
        ({"content": ONES + bytes(4), "offset": 4}, "have tensors in 'graphs/semantic.weights' that overlap."),
        ({"content": ONES + TWOS}, "up to byte 8 of 'graphs/semantic.weights', which has 16."),
        ({"offset": 8}, "up to byte 16 of 'graphs/semantic.weights', which has 8."),
        ({"content": ONES + bytes(64) + TWOS, "offset": 72}, "has bytes from 8 to 72 that are no tensor's."),
        ({"content": ONES + b"hidden, 8" + bytes(47) + TWOS, "offset": 64}, "from 8 to 64 that are no tensor's."),
        ({"weights": None}, "text keeps tensors in 'semantic.weights', and its manifest says that it keeps none."),
        ({"weights": "graphs/no.weights"}, "text has its tensors in 'graphs/no.weights', which its manifest does not"),
        ({"weights": "tools/marker.toml"}, "text keeps tensors in 'semantic.weights', and its manifest says in 'tools"),
    ],
)
def test_open_bundle_rejects_a_shared_file_that_the_tensors_of_its_graphs_do_not_cover(
    bundle: Path, shared: dict[str, Any], sentence: str
) -> None:
    put_shared(bundle, **shared)
    with pytest.raises(BundleError, match=re.escape(sentence)) as error:
        open_bundle(bundle)
    assert str(error.value).count(". ") == 0  # one sentence


def test_open_bundle_rejects_two_tensors_of_a_graph_at_one_place(bundle: Path) -> None:
    put_outside(bundle)
    model = onnx.load_from_string((bundle / SEMANTIC).read_bytes())
    model.graph.initializer.append(model.graph.initializer[0])
    model.graph.initializer[1].name = "other"
    put(bundle, model)
    with pytest.raises(BundleError, match=r"two tensors at the same place in 'graphs/semantic\.weights'"):
        open_bundle(bundle)


def test_graphs_are_computed_by_the_chosen_provider(bundle: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PENTIMENTO_PROVIDER", "cpu")
    assert Graphs(open_bundle(bundle))("semantic", np.zeros((1, 2), np.float32))[0].tolist() == [[1, 1]]
    monkeypatch.setenv("PENTIMENTO_PROVIDER", "npu")
    with pytest.raises(ConfigError, match="must be one of cpu, cuda, tensorrt, coreml"):
        Graphs(open_bundle(bundle))
    missing = next(
        name for name, provider in (("cuda", "CUDA"), ("coreml", "CoreML"))
        if f"{provider}ExecutionProvider" not in onnxruntime.get_available_providers()
    )  # fmt: skip
    monkeypatch.setenv("PENTIMENTO_PROVIDER", missing)
    with pytest.raises(ConfigError, match=f"is '{missing}', but onnxruntime has .*CPUExecutionProvider here"):
        Graphs(open_bundle(bundle))


def _too_large(model: onnx.ModelProto) -> None:
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.float_data.append(0.0)
    tensor.dims[0] = 2**40


def _hollow(model: onnx.ModelProto) -> None:
    model.graph.initializer[0].dims[0] = 2**40


def _newer(model: onnx.ModelProto) -> None:
    model.opset_import[0].version = 22


def _older(model: onnx.ModelProto) -> None:
    model.opset_import[0].version = 18


def _other_format(model: onnx.ModelProto) -> None:
    model.ir_version = 11


def _plug_in(model: onnx.ModelProto) -> None:
    model.opset_import.add(domain="com.microsoft", version=1)


def _other_input(model: onnx.ModelProto) -> None:
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 3


def _other_output(model: onnx.ModelProto) -> None:
    model.graph.output[0].name = "z"


@pytest.mark.parametrize(
    ("tamper", "message"),
    [
        (_too_large, "a tensor of 8796093022208 bytes"),
        (_hollow, "needs 8796093022208 bytes and has 8"),
        (_newer, "operator sets {'': 22}"),
        (_older, "operator sets {'': 18}"),
        (_other_format, "IR version 11"),
        (_plug_in, "com.microsoft"),
        (_other_input, "has the inputs"),
        (_other_output, "has the outputs"),
    ],
)
def test_open_bundle_rejects_graphs_that_differ_from_the_manifest(
    bundle: Path, tamper: Callable[[onnx.ModelProto], None], message: str
) -> None:
    model = graph()
    tamper(model)
    put(bundle, model)
    with pytest.raises(BundleError, match=message):
        open_bundle(bundle)


def test_open_bundle_rejects_unsupported_versions(bundle: Path) -> None:
    for name in GRAPHS:
        (bundle / f"graphs/{name}.onnx").write_bytes(graph(opset=25).SerializeToString())
    relist(bundle)
    change(bundle, opset=25)
    with pytest.raises(BundleError, match=r"operator sets {'': 25}"):
        open_bundle(bundle)


def test_open_bundle_rejects_oversized_files_before_reading(bundle: Path) -> None:
    files = json.loads((bundle / MANIFEST).read_text())["files"]
    files[SEMANTIC]["bytes"] = MAX_FILE_BYTES + 1
    change(bundle, files=files)
    with pytest.raises(BundleError, match="are the maximum"):
        open_bundle(bundle)


@pytest.mark.parametrize(
    "limit", ["max_press_depth_m", "max_speed_m_s", "max_acceleration_m_s2", "x_max_m", "max_duration_s"]
)
def test_open_bundle_rejects_an_envelope_that_differs_from_the_tools(bundle: Path, limit: str) -> None:
    settings_ = json.loads((bundle / MANIFEST).read_text())["settings"]
    settings_["pen"]["envelope"][limit] *= 1.01
    change(bundle, settings=settings_)
    with pytest.raises(BundleError, match="safety envelope of pen is not that of its tool"):
        open_bundle(bundle)


def test_open_bundle_rejects_a_tool_with_another_envelope(bundle: Path) -> None:
    text = (bundle / "tools/marker.toml").read_text()
    (bundle / "tools/marker.toml").write_text(text.replace('"1 mm"', '"9 mm"'))
    relist(bundle)
    with pytest.raises(BundleError, match="is not that of its tool"):
        open_bundle(bundle)


def test_open_bundle_rejects_an_envelope_wider_than_the_local_one(bundle: Path) -> None:
    own = envelope_for(load_tool("marker"), CANVAS_M)
    assert open_bundle(bundle, local={"pen": own}).setting("pen").envelope == own
    assert open_bundle(bundle, local={"pen": replace(own, max_speed_m_s=1.0)})
    with pytest.raises(BundleError, match="wider than this robot's own in max_speed_m_s, max_duration_s"):
        open_bundle(bundle, local={"pen": replace(own, max_speed_m_s=0.01, max_duration_s=5.0)})


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"schema": 1}, "schema 1 and this version reads 10; write the bundle again with the stage deploy"),
        ({"sculpting": {"clay_foam": to_plain(SETTINGS)}}, "refers to 'clay_foam'"),
        ({"schema": "1"}, "schema '1'"),
        ({"more": 1}, r"unknown keys \['more'\]"),
        ({"brushes": {}}, "refers to 'pen'"),
        ({"models": {}}, "refers to 'stroke_marker'"),
        ({"opset": 20.0}, "a whole number"),
    ],
)
def test_open_bundle_rejects_an_invalid_manifest(bundle: Path, entries: dict[str, Any], message: str) -> None:
    change(bundle, **entries)
    with pytest.raises(BundleError, match=message):
        open_bundle(bundle)


def test_open_bundle_reads_what_the_goal_planner_was_taught(bundle: Path, tmp_path: Path) -> None:
    assert open_bundle(bundle).vocabulary is None
    taught = write_painting_bundle(tmp_path / "taught", small_vocabulary())
    assert open_bundle(taught).vocabulary == small_vocabulary()


def test_open_bundle_reads_hands_and_names_them(tmp_path: Path) -> None:
    opened = open_bundle(write_painting_bundle(tmp_path / "hands", hands=("anna", "bert")))
    assert opened.hand("anna").points == HAND_POINTS
    with pytest.raises(BundleError, match=r"no hand 'carl'; it has anna, bert\."):
        opened.hand("carl")


def test_open_bundle_without_hands_says_so(bundle: Path) -> None:
    with pytest.raises(BundleError, match=r"has no hands, .* deploy --hands"):
        open_bundle(bundle).hand("anna")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "holds no decoder"),
        (b"PK\x03\x04 and no more", "holds no decoder"),
        (decoder_bytes(small_hand("bert")), "is in its file that of 'bert'"),
        (decoder_bytes(small_hand("anna", 5)), "has paths of 5 points, and the brush pen_path of 6"),
    ],
)
def test_open_bundle_rejects_a_damaged_hand(tmp_path: Path, content: bytes, message: str) -> None:
    folder = write_painting_bundle(tmp_path / "hands", hands=("anna",))
    (folder / "hands/anna.npz").write_bytes(content)
    relist(folder)
    with pytest.raises(BundleError, match=message):
        open_bundle(folder)


@pytest.mark.parametrize("text", ["", "[]", '{"nouns": {}}', '{"notice": "", "nouns": {"cat": "cats"}}', "[" * 100_000])
def test_open_bundle_rejects_a_damaged_vocabulary(tmp_path: Path, text: str) -> None:
    taught = write_painting_bundle(tmp_path / "taught", small_vocabulary())
    (taught / "words/nouns.json").write_text(text)
    relist(taught)
    with pytest.raises(BundleError, match=r"is refused: words/nouns\.json"):
        open_bundle(taught)
    (taught / "words/nouns.json").unlink()
    relist(taught)
    with pytest.raises(BundleError, match=r"refers to 'words/nouns\.json'"):
        open_bundle(taught)


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"schema": 10, "schema": 10}', '{"schema": NaN}', "[" * 100_000, "\xff"]
)
def test_open_bundle_rejects_malformed_json(bundle: Path, text: str) -> None:
    (bundle / MANIFEST).write_bytes(text.encode("latin-1"))
    with pytest.raises(BundleError, match="is refused"):
        open_bundle(bundle)


def test_open_bundle_rejects_parity_above_tolerance(bundle: Path) -> None:
    graphs = json.loads((bundle / MANIFEST).read_text())["graphs"]
    graphs["semantic"]["parity"] = {"y": 2e-4}
    change(bundle, graphs=graphs)
    with pytest.raises(BundleError, match="differs from its model"):
        open_bundle(bundle)


def test_open_bundle_rejects_a_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="is no bundle"):
        open_bundle(tmp_path / "nothing")


def test_bundle_check_imports_no_onnx_runtime() -> None:
    for module in ("bundle/reader", "bundle/onnx_header", "contracts/codec"):
        names = imported_names(ROOT / f"src/pentimento/{module}.py")
        assert not {name for name in names if name.startswith("onnx")}


def test_open_bundle_rejects_a_tensor_above_the_limit(bundle: Path) -> None:
    model = graph()
    model.graph.initializer.append(numpy_helper.from_array(np.zeros((1000, 1000), np.float32), "large"))
    put(bundle, model)
    assert len(open_bundle(bundle).graph("semantic")) > 4_000_000
