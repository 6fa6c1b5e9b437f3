"""Folders to run stages in, each with an empty MLflow store of its own."""

from collections.abc import Callable
from pathlib import Path

import pytest

Enter = Callable[[Path, pytest.MonkeyPatch], None]


@pytest.fixture(scope="session")
def enter(tmp_path_factory: pytest.TempPathFactory) -> Enter:
    """Makes a folder the current one, with an MLflow store; creating its tables takes seconds, copying them nothing."""
    from mlflow import MlflowClient

    file = tmp_path_factory.mktemp("store") / "mlflow.db"
    MlflowClient(f"sqlite:///{file}").search_experiments()
    empty = file.read_bytes()

    def entered(folder: Path, patch: pytest.MonkeyPatch) -> None:
        (folder / "mlflow.db").write_bytes(empty)
        patch.chdir(folder)
        patch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{folder / 'mlflow.db'}")

    return entered


@pytest.fixture
def stage_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, enter: Enter) -> Path:
    """The current folder, with nothing but an MLflow store."""
    enter(tmp_path, monkeypatch)
    return tmp_path
