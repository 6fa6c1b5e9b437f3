"""dvc.yaml tells the truth: each stage's name, parameters and code dependencies are those of its module."""

import re
import shutil
import subprocess
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest
from dvc.utils.serialize import modify_yaml

from pipelines._deps import CODE, pipelines, with_dependencies
from pipelines._imports import ROOT
from pipelines._params import files_named_by, read_yaml, sections_of

STAGES: dict[str, dict[str, Any]] = read_yaml(ROOT / "dvc.yaml")["stages"]
PARAMS = read_yaml(ROOT / "params.yaml")


def test_stage_module_and_params_section_bear_one_name() -> None:
    public = {file.stem for file in (ROOT / "pipelines").glob("*.py") if not file.stem.startswith("_")}
    presets = {section for stage in STAGES for section in sections_of(stage, PARAMS)} - set(STAGES)
    assert set(PARAMS) == set(STAGES) | presets, "a section is neither a stage's nor a preset that some stage uses"
    assert set(STAGES) <= public
    for name, stage in STAGES.items():
        assert f"python -m pipelines.{name} " in stage["cmd"] + " "
        assert stage["params"] == sections_of(name, PARAMS), "a changed preset would not run the stage again"


def test_written_dependencies_are_up_to_date() -> None:
    for file, params in pipelines().items():
        text = file.read_text(encoding="utf-8")
        assert text == with_dependencies(text, params), f"the dependencies in {file} are stale; run `make deps`"


@pytest.mark.parametrize("stage", STAGES)
def test_what_a_stage_reads_and_writes_stands_in_its_command(stage: str) -> None:
    command = STAGES[stage]["cmd"].split()
    for path in STAGES[stage]["outs"]:
        assert path in command, f"{stage} writes {path}, but its command does not say so"
    named = files_named_by(stage, PARAMS, ROOT)
    for path in (path for path in STAGES[stage]["deps"] if path not in named):
        given = any(Path(path).is_relative_to(word) for word in command if not word.startswith("-"))
        assert path.startswith(CODE) or given, f"{stage} reads {path}, but its command does not say so"


def test_no_output_stands_at_or_above_a_tracked_file() -> None:
    """DVC would delete that file with the output."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    for out in (out for stage in STAGES.values() for out in stage["outs"]):
        pattern = re.sub(r"\$\{.*?\}", "*", out)
        inside = [file for file in listed.stdout.splitlines() if fnmatch(f"{file}/", f"{pattern}/*")]
        assert not inside, f"{out} holds files that git tracks: {inside}"


def test_every_model_and_the_bundle_has_a_name_by_which_dvc_gets_it() -> None:
    """`dvc artifacts get` and GTO tags know artifacts; a card beside the weights tells more."""
    written = read_yaml(ROOT / "dvc.yaml")
    lists = {key: names for entry in written["vars"] for key, names in entry.items()}
    models = set[str]()
    for stage in STAGES.values():
        for out in (out for out in stage["outs"] if out.startswith("models/")):
            keys = [re.sub(r"[${}]", "", listed) for listed in stage.get("matrix", {}).values()]
            names = [name for key in keys for name in lists[key]] or [""]
            models |= {re.sub(r"\$\{.*?\}", name, out) for name in names}
    artifacts = written["artifacts"]
    assert {entry["path"] for entry in artifacts.values()} == models
    for name, entry in artifacts.items():
        assert name == entry["path"].removeprefix("models/").removesuffix("/weights")
        assert entry["type"] in ("model", "bundle") and entry["desc"]


def test_dvc_can_change_a_parameter_in_place(tmp_path: Path) -> None:
    """`dvc exp run -S` writes the file in a layout of its own, without quotes; every value must survive that."""
    copy = tmp_path / "params.yaml"
    shutil.copy(ROOT / "params.yaml", copy)
    with modify_yaml(str(copy)) as params:
        params["paint"]["strokes"] += 1
    assert read_yaml(copy) == PARAMS | {"paint": PARAMS["paint"] | {"strokes": PARAMS["paint"]["strokes"] + 1}}
