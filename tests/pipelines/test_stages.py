"""dvc.yaml tells the truth: each stage's name, parameters and code dependencies are those of its module."""

import re
import subprocess
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest

from pipelines._config import read_yaml
from tests.imports import ROOT, has_code, import_closure

STAGES: dict[str, dict[str, Any]] = read_yaml(ROOT / "dvc.yaml")["stages"]
CODE = ("src/", "pipelines/")
DATA = {"studio": "*.toml", "robots": "*.toml", "report": "*.css"}  # read when any code of the package is reached


def module(stage: str) -> Path:
    return ROOT / "pipelines" / f"{stage}.py"


def code_dependencies(stage: str) -> list[Path]:
    return [ROOT / dep for dep in STAGES[stage]["deps"] if dep.startswith(CODE)]


def needed_files(stage: str) -> set[Path]:
    """Return the project files that the stage executes or reads as package data."""
    files = {file for file in import_closure(module(stage)) if has_code(file)}
    for name, pattern in DATA.items():
        folder = ROOT / "src/pentimento" / name
        if any(file.is_relative_to(folder) for file in files):
            files |= set(folder.rglob(pattern))
    return files


def test_stage_module_and_params_section_bear_one_name() -> None:
    public = {file.stem for file in (ROOT / "pipelines").glob("*.py") if not file.stem.startswith("_")}
    sections = set(read_yaml(ROOT / "params.yaml"))
    assert set(STAGES) == sections
    assert set(STAGES) <= public
    for name, stage in STAGES.items():
        assert f"python -m pipelines.{name} " in stage["cmd"] + " "
        assert stage["params"] == [name]


@pytest.mark.parametrize("stage", STAGES)
def test_every_needed_file_is_a_dependency(stage: str) -> None:
    dependencies = code_dependencies(stage)
    missing = {
        str(file.relative_to(ROOT))
        for file in needed_files(stage)
        if not any(file.is_relative_to(dependency) for dependency in dependencies)
    }
    assert not missing, f"add these (or their folders) to the deps of {stage} in dvc.yaml: {sorted(missing)}"


@pytest.mark.parametrize("stage", STAGES)
def test_every_code_dependency_is_needed(stage: str) -> None:
    needed = needed_files(stage)
    idle = [
        str(dependency.relative_to(ROOT))
        for dependency in code_dependencies(stage)
        if not any(file.is_relative_to(dependency) for file in needed)
    ]
    assert not idle, f"{stage} does not import these; remove them from its deps in dvc.yaml: {idle}"


@pytest.mark.parametrize("stage", STAGES)
def test_what_a_stage_reads_and_writes_stands_in_its_command(stage: str) -> None:
    command = STAGES[stage]["cmd"].split()
    for path in STAGES[stage]["outs"]:
        assert path in command, f"{stage} writes {path}, but its command does not say so"
    for path in STAGES[stage]["deps"]:
        given = any(Path(path).is_relative_to(word) for word in command if not word.startswith("-"))
        assert path.startswith(CODE) or given, f"{stage} reads {path}, but its command does not say so"


def test_no_output_stands_at_or_above_a_tracked_file() -> None:
    """DVC would delete that file with the output."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    for out in (out for stage in STAGES.values() for out in stage["outs"]):
        pattern = re.sub(r"\$\{.*?\}", "*", out)
        inside = [file for file in listed.stdout.splitlines() if fnmatch(f"{file}/", f"{pattern}/*")]
        assert not inside, f"{out} holds files that git tracks: {inside}"
