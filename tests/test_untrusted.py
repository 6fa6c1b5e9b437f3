"""What comes from outside is data: nothing that is read can run code, and tests reach no network."""

import ast
import socket
from pathlib import Path

import numpy as np
import pytest

from pentimento.goals3d.sources import GoalError, height_file_relief
from pipelines._imports import PIPELINES, ROOT, SOURCES

CODE = [*SOURCES, *PIPELINES, *sorted((ROOT / "studies").rglob("*.py")), *sorted((ROOT / "examples").rglob("*.py"))]
UNPICKLING = {"pickle", "cPickle", "dill", "joblib", "cloudpickle", "shelve", "marshal"}


def calls(file: Path) -> list[tuple[str, ast.Call]]:
    """Every call in a file with its dotted name."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return [(ast.unparse(node.func), node) for node in ast.walk(tree) if isinstance(node, ast.Call)]


def keyword(call: ast.Call, name: str) -> object:
    return next((k.value.value for k in call.keywords if k.arg == name and isinstance(k.value, ast.Constant)), None)


def test_nothing_is_unpickled() -> None:
    """`torch.load` takes weights only, `np.load` no objects, and nobody calls an unpickler."""
    loads = 0
    for file in CODE:
        for name, call in calls(file):
            top, _, last = name.rpartition(".")
            assert not (top.split(".")[0] in UNPICKLING and last in ("load", "loads", "Unpickler")), f"{file}: {name}"
            assert last not in ("read_pickle", "unsafe_load"), f"{file}: {name}"
            if name == "torch.load":
                loads += 1
                assert keyword(call, "weights_only") is True, file
            if name in ("np.load", "numpy.load"):
                loads += 1
                given = [k.value for k in call.keywords if k.arg == "allow_pickle"]  # by default, numpy refuses objects
                assert all(isinstance(value, ast.Constant) and value.value is False for value in given), file
            if name == "YAML":
                assert keyword(call, "typ") in (None, "safe"), f"{file}: ruamel's unsafe loader"
    assert loads >= 3


class _Touches:
    """Writes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.path,)


def test_a_malicious_array_is_refused_and_does_nothing(tmp_path: Path) -> None:
    harm = tmp_path / "harm"
    np.save(tmp_path / "goal.npy", np.array([_Touches(harm)], dtype=object), allow_pickle=True)
    with pytest.raises(GoalError, match="height map"):
        height_file_relief(tmp_path / "goal.npy")
    assert not harm.exists()
    np.load(tmp_path / "goal.npy", allow_pickle=True)
    assert harm.exists()  # so it would have


def test_no_test_reaches_a_network() -> None:
    """192.0.2.0/24 is nobody's (RFC 5737): without the guard, this would wait and then fail in another way."""
    with socket.socket() as outside, pytest.raises(RuntimeError, match="loopback"):
        outside.connect(("192.0.2.1", 80))
    with socket.socket() as outside, pytest.raises(RuntimeError, match="loopback"):
        outside.connect_ex(("198.51.100.1", 443))


def test_loopback_is_free_to_use() -> None:
    with socket.socket() as server, socket.socket() as client:
        server.bind(("127.0.0.1", 0))
        server.listen(1)
        client.connect(server.getsockname())
