"""A copy of the project's own pipeline files, to be edited."""

import shutil
from pathlib import Path

from pipelines._imports import ROOT

PACKAGE_DATA = ("robots/tools", "studio/worlds", "studio/clay/worlds")


def copy_project(folder: Path) -> Path:
    """dvc.yaml, params.yaml, the profiles, and the package's tool and world files, under ``folder``."""
    for name in ("dvc.yaml", "params.yaml"):
        shutil.copy(ROOT / name, folder)
    shutil.copytree(ROOT / "profiles", folder / "profiles")
    for name in PACKAGE_DATA:
        shutil.copytree(ROOT / "src/pentimento" / name, folder / "src/pentimento" / name)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    """Every file under ``folder``."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
