"""dvc.lock, whole: DVC empties the file before it writes it, and another stage may end at any moment."""

import fcntl
from pathlib import Path
from typing import Any

from pipelines._config import read_yaml


def locked_stages(folder: Path) -> dict[str, Any]:
    """Return what dvc.lock in `folder` says, by stage item; empty where nothing ran yet.

    It is read under DVC's own lock, which DVC holds while it writes and gives up while a stage runs.
    """
    file = folder / "dvc.lock"
    if not file.is_file():
        return {}
    lock = folder / ".dvc/tmp/lock"
    if not lock.is_file():  # no DVC ever ran here
        return _stages(file)
    with lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_SH)
        return _stages(file)


def _stages(file: Path) -> dict[str, Any]:
    stages: dict[str, Any] = read_yaml(file).get("stages", {})
    return stages
