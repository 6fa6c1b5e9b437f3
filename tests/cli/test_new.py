"""Tests of `pentimento new`."""

import difflib
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pentimento.cli.main import main
from pentimento.cli.new import Created, new_material, new_tool
from pentimento.cli.pipeline_files import with_listed_paths
from pentimento.contracts.errors import ConfigError
from pentimento.robots.tools import load_tool
from pentimento.studio.clay.world import load_clay_world
from pentimento.studio.strokes.world import load_world
from pipelines._config import load_section
from pipelines._imports import ROOT
from pipelines._params import read_params
from pipelines.collect_strokes import CollectStrokes
from pipelines.paint import Paint
from pipelines.sculpt import Sculpt

WORLDS = "src/pentimento/studio/strokes/worlds"


def copy_project(folder: Path) -> Path:
    """dvc.yaml, params.yaml, and the package's tool and world files, under ``folder``."""
    for name in ("dvc.yaml", "params.yaml"):
        shutil.copy(ROOT / name, folder)
    for name in ("robots/tools", "studio/strokes/worlds", "studio/clay/worlds"):
        shutil.copytree(ROOT / "src/pentimento" / name, folder / "src/pentimento" / name)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    """Every file under ``folder``."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def stage_names(folder: Path) -> set[str]:
    listed = subprocess.run(
        [sys.executable, "-m", "dvc", "stage", "list", "--name-only"],
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return set(listed.stdout.split())


@pytest.mark.parametrize(
    ("create", "like", "stages"),
    [
        (new_tool, "round_brush", ["collect_strokes", "train_stroke_dynamics", "diagnose_gap", "paint"]),
        (new_material, "foam", ["collect_pushes", "train_push_dynamics", "diagnose_pushes", "sculpt"]),
    ],
    ids=["tool", "material"],
)
def test_creation_only_adds_the_new_name(
    create: Callable[..., Created], like: str, stages: list[str], tmp_path: Path
) -> None:
    root = copy_project(tmp_path)
    before = contents(root)
    created = create(root, "quill", like)
    after = contents(root)
    assert list(created.stages) == [f"{stage}@quill" for stage in stages]
    changed = {name for name in after if after[name] != before.get(name)}
    assert changed == {str(path.relative_to(root)) for path in created.files}
    for name in ("dvc.yaml", "params.yaml"):
        old, new = before[name].decode().splitlines(), after[name].decode().splitlines()
        assert sum(line.startswith("    #") for line in old) == sum(line.startswith("    #") for line in new)
        differing = [line for line in difflib.ndiff(old, new) if line.startswith(("+", "-"))]
        without = [line for line in differing if "quill" not in line]
        # A line that goes comes back with the new name in it.
        assert all(line.startswith("-") for line in without) and len(without) < len(differing)
    assert with_listed_paths((root / "dvc.yaml").read_text()) == (root / "dvc.yaml").read_text()


def test_dvc_has_the_new_stages_and_params_have_their_settings(tmp_path: Path) -> None:
    root = copy_project(tmp_path)
    subprocess.run([sys.executable, "-m", "dvc", "init", "--no-scm", "-q"], cwd=root, check=True)
    before = stage_names(root)
    created = [*new_tool(root, "quill", "marker").stages, *new_material(root, "wax", "foam").stages]
    assert stage_names(root) == before | set(created)
    params = root / "params.yaml"
    assert load_section(params, "collect_strokes", CollectStrokes).source == {}
    painting = load_section(params, "paint", Paint).settings
    assert (painting["quill"].tool, painting["quill"].world) == ("quill", "quill")
    assert painting["quill"].planner == painting["marker"].planner
    deployed = read_params(params)["deploy"]
    assert deployed["settings"]["quill"] == deployed["settings"]["marker"] | {"tool": "quill"}
    assert deployed["clays"]["wax"] == deployed["clays"]["foam"]
    assert load_section(params, "sculpt", Sculpt).settings["wax"].world == "wax"
    assert "models/stroke_quill/weights" in (root / "dvc.yaml").read_text()


def test_tool_file_and_world_are_copies_of_the_followed_tool(tmp_path: Path) -> None:
    root = copy_project(tmp_path)
    tool_file, world_file = new_tool(root, "quill", "round_brush").files[:2]
    tool, like = load_tool(tool_file), load_tool("round_brush")
    assert (tool.name, tool.nominal_width_m, tool.press_range_m) == ("quill", like.nominal_width_m, like.press_range_m)
    assert load_world(world_file).effects == load_world("round_brush").effects
    assert load_world(world_file).tool.name == "quill"
    assert load_clay_world(new_material(root, "wax", "foam").files[0]).material.name == "wax"


def test_accepts_a_tool_file_a_world_file_and_measured_strokes(tmp_path: Path) -> None:
    root = copy_project(tmp_path)
    tool_file = (root / "src/pentimento/robots/tools/round_brush.toml").read_text()
    (root / "tool.toml").write_text(tool_file.replace('"round_brush"', '"quill"').replace('"7 mm"', '"9 mm"'))
    (root / "true.toml").write_text('base = "plain.toml"\n[tool]\nname = "quill"\nsplay = 0.1\n')
    (root / "rows.parquet").write_bytes(b"")
    new_tool(
        root,
        "quill",
        "round_brush",
        tool_file=root / "tool.toml",
        world=root / "true.toml",
        source=Path("rows.parquet"),
    )
    assert load_tool(root / "src/pentimento/robots/tools/quill.toml").nominal_width_m == pytest.approx(0.009)
    assert load_world(root / WORLDS / "quill.toml").tool.splay == 0.1
    assert read_params(root / "params.yaml")["collect_strokes"]["source"] == {"quill": "rows.parquet"}


def test_a_tool_like_one_without_a_painting_gets_none(tmp_path: Path) -> None:
    created = new_tool(copy_project(tmp_path), "quill", "flat_brush")
    assert [note.split()[0] for note in created.notes] == ["No", "The"] and "paint@quill" not in created.stages
    assert "quill" not in read_params(tmp_path / "params.yaml")["paint"]["settings"]


@pytest.mark.parametrize(
    ("name", "like", "world", "says"),
    [
        ("marker", "round_brush", None, "exists already"),
        ("colour", "round_brush", None, "exists already"),
        ("Quill", "round_brush", None, "small letters"),
        ("../quill", "round_brush", None, "small letters"),
        ("quill_base", "round_brush", None, "_base"),
        ("quill", "feather", None, "known are marker"),
        ("quill", "round_brush", 'base = "plain.toml"\n', "is that of round_brush"),
        ("quill", "round_brush", 'base = "plain.toml"\n[tool]\nnam = "quill"\n', r"unknown keys \['nam'\]"),
        ("quill", "round_brush", "torn = [", "not valid TOML"),
    ],
)
def test_invalid_name_or_world_changes_nothing(
    name: str, like: str, world: str | None, says: str, tmp_path: Path
) -> None:
    root = copy_project(tmp_path)
    place = None
    if world is not None:
        place = root / "world.toml"
        place.write_text(world)
    before = contents(root)
    with pytest.raises(ConfigError, match=says):
        new_tool(root, name, like, world=place)
    assert contents(root) == before


@pytest.mark.parametrize(
    ("world", "source", "says"),
    [
        (b'base = "foam.toml"\n', None, "is that of foam"),
        (b"\xff\xfe", None, "not UTF-8"),
        (None, Path("nowhere"), "nowhere does not exist"),
    ],
)
@pytest.mark.parametrize("create", [new_tool, new_material])
def test_unusable_file_changes_nothing(
    create: Callable[..., object], world: bytes | None, source: Path | None, says: str, tmp_path: Path
) -> None:
    root = copy_project(tmp_path)
    place, like = None, "foam" if create is new_material else "round_brush"
    if world is not None:
        place = root / "world.toml"
        place.write_bytes(world.replace(b"foam", b"plain") if create is new_tool else world)
    before = contents(root)
    with pytest.raises(ConfigError, match=says.replace("foam", like)):
        create(root, "quill", like, world=place, source=source)
    assert contents(root) == before


def test_command_prints_the_next_steps_and_refuses_an_existing_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(copy_project(tmp_path))
    assert main(["new", "tool", "quill", "--like", "round_brush"]) == 0
    printed = capsys.readouterr().out
    assert "tools/quill.toml" in printed
    assert "dvc repro -s collect_strokes@quill train_stroke_dynamics@quill diagnose_gap@quill\n" in printed
    assert "dvc repro -s paint@quill\n" in printed
    before = contents(tmp_path)
    assert main(["new", "tool", "quill", "--like", "round_brush"]) == 1
    assert "'quill' exists already" in capsys.readouterr().err
    assert contents(tmp_path) == before
    assert main(["new", "material", "wax", "--like", "foam"]) == 0
    assert main(["new", "material", "wax", "--like", "foam"]) == 1
    assert "'wax' exists already" in capsys.readouterr().err
    assert main(["new", "material", "foam_edge", "--like", "foam"]) == 1, "params.yaml has such a combination"


def test_command_outside_a_project_says_where_to_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "tool", "quill", "--like", "round_brush"]) == 1
    assert "dvc.yaml does not exist" in capsys.readouterr().err and not list(tmp_path.iterdir())
