"""Settings of every test: no network, one thread, no colours, slow files first."""

import os
import socket
from typing import Any

import pytest

os.environ.update(
    HF_HUB_OFFLINE="1",
    MLFLOW_DISABLE_TELEMETRY="true",
    DO_NOT_TRACK="true",
    OMP_NUM_THREADS="1",
    NO_COLOR="1",
    MPLBACKEND="Agg",
)

# Slow files, in the order in which they begin: one that began last would leave the other process without work. Files
# of one row run in one process, because they share a fixture that takes long to create.
_SLOW = (
    ("tests/diagnosis/strokes/test_families.py",),
    ("tests/diagnosis/pushes/test_families.py",),
    ("tests/diagnosis/strokes/test_blind_worlds.py",),
    tuple(
        f"tests/diagnosis/strokes/test_{name}.py"
        for name in ("figures", "next_actions", "page", "problem", "user_baseline", "verdict", "write")
    ),
    ("tests/pipelines/test_deploy.py", "tests/deploy/test_bundle.py", "tests/bundle/test_graphs.py"),
    ("tests/test_cli.py",),
    ("tests/test_lean_wheel.py",),
    ("tests/diagnosis/pushes/",),
    ("tests/pipelines/test_diagnose_gap.py",),
    ("tests/pipelines/test_evaluate_copainting.py",),
    ("tests/pipelines/test_synthesize_copaintings.py",),
    ("tests/pipelines/test_train_semantics.py",),
    ("tests/pipelines/test_goal_planner_stages.py",),
    ("tests/pipelines/test_run_bundle.py",),
    ("tests/studies/test_blind_table.py",),
)


def _row(nodeid: str) -> int:
    return next((number for number, row in enumerate(_SLOW) if nodeid.startswith(row)), len(_SLOW))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: _row(item.nodeid))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    from xdist.scheduler import LoadFileScheduling  # type: ignore[import-untyped]

    class ByRow(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            row = _row(nodeid)
            return str(row) if row < len(_SLOW) else super()._split_scope(nodeid)

    return ByRow(config, log)


_HERE = ("127.", "::1", "localhost", "0.0.0.0")
_connect, _connect_ex = socket.socket.connect, socket.socket.connect_ex


def _checked(address: Any) -> None:
    """Refuse what is neither this computer nor a file: no test may need a network."""
    if isinstance(address, tuple) and not str(address[0]).startswith(_HERE):
        raise RuntimeError(f"A test asked for {address[0]}: tests use the loopback alone.")


def _only_here(self: socket.socket, address: Any) -> None:
    _checked(address)
    _connect(self, address)


def _only_here_ex(self: socket.socket, address: Any) -> int:
    _checked(address)
    return _connect_ex(self, address)


socket.socket.connect = _only_here  # type: ignore[method-assign]
socket.socket.connect_ex = _only_here_ex  # type: ignore[method-assign]
