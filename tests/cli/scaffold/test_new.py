"""A new tool or material stands wherever the one it follows stands, and nothing else changes."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pentimento.cli.main import main
from pentimento.cli.scaffold.material import new_material
from pentimento.cli.scaffold.tool import new_tool
from pentimento.contracts.errors import ConfigError
from pentimento.robots.tools import load_tool
from pentimento.studio.clay.world import load_clay_world
from pentimento.studio.world import load_world
from pipelines._config import load_section, read_yaml
from pipelines.collect_strokes import CollectStrokes
from pipelines.paint import Paint
from pipelines.sculpt import Sculpt
from tests.cli.scaffold.project import contents, copy_project

WORLDS = "src/pentimento/studio/worlds"


def comments(text: bytes) -> list[str]:
    return [line.strip() for line in text.decode().splitlines() if line.strip().startswith("#")]


def without(value: Any, name: str) -> Any:
    """A YAML document as it was before ``name`` came in."""
    if isinstance(value, dict):
        return {key: without(inner, name) for key, inner in value.items() if key != name}
    if isinstance(value, list):
        return [without(inner, name) for inner in value if not (isinstance(inner, str) and name in inner)]
    return value.replace(f" {name}", "") if isinstance(value, str) else value


def stage_names(folder: Path) -> set[str]:
    listed = subprocess.run(
        [sys.executable, "-m", "dvc", "stage", "list", "--name-only"],
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return set(listed.stdout.split())


@pytest.mark.parametrize(
    ("make", "stages"),
    [
        (
            lambda root: new_tool(root, "quill", "round_brush"),
            ["collect_strokes@quill", "train_stroke_dynamics@quill", "diagnose_gap@quill", "paint@quill"],
        ),
        (
            lambda root: new_material(root, "quill", "foam"),
            ["collect_pushes@quill", "train_push_dynamics@quill", "diagnose_pushes@quill", "sculpt@quill"],
        ),
    ],
    ids=["tool", "material"],
)
def test_the_rest_of_the_project_stays_as_it_is(make: Callable[[Path], Any], stages: list[str], tmp_path: Path) -> None:
    root = copy_project(tmp_path)
    before = contents(root)
    made = make(root)
    after = contents(root)
    assert list(made.stages) == stages
    changed = {name for name in after if after[name] != before.get(name)}
    assert changed == {str(path.relative_to(root)) for path in made.files}
    for name in before:
        if name.endswith(".yaml"):
            (tmp_path / "was.yaml").write_bytes(before[name])
            was, now = read_yaml(tmp_path / "was.yaml"), read_yaml(root / name)
            assert without(now, "quill") == was
            assert now != was
            assert comments(after[name]) == comments(before[name])


def test_dvc_knows_the_new_stages_and_every_stage_s_settings_are_whole(tmp_path: Path) -> None:
    root = copy_project(tmp_path)
    subprocess.run([sys.executable, "-m", "dvc", "init", "--no-scm", "-q"], cwd=root, check=True)
    before = stage_names(root)
    made = [*new_tool(root, "quill", "marker").stages, *new_material(root, "wax", "foam").stages]
    assert stage_names(root) == before | set(made)
    params = root / "params.yaml"
    assert load_section(params, "collect_strokes", CollectStrokes).world["quill"] == "quill"
    assert load_section(params, "paint", Paint).settings["quill"].tool == "quill"
    assert read_yaml(params)["deploy"]["settings"]["quill"]["tool"] == "quill"
    assert load_section(params, "sculpt", Sculpt).settings["wax"].world == "wax"


def test_what_the_robot_is_told_and_what_is_true_are_the_other_s_until_they_are_changed(tmp_path: Path) -> None:
    root = copy_project(tmp_path)
    tool_file, world_file = new_tool(root, "quill", "round_brush").files[:2]
    told, like = load_tool(tool_file), load_tool("round_brush")
    assert (told.name, told.nominal_width_m, told.press_range_m) == ("quill", like.nominal_width_m, like.press_range_m)
    assert load_world(world_file).effects == load_world("round_brush").effects
    assert load_world(world_file).tool.name == "quill"
    assert load_clay_world(new_material(root, "wax", "foam").files[0]).material.name == "wax"


def test_given_measures_a_given_world_and_measured_strokes_are_taken(tmp_path: Path) -> None:
    root = copy_project(tmp_path)
    given = load_tool_text(root).replace('"round_brush"', '"quill"').replace('"7 mm"', '"9 mm"')
    (root / "told.toml").write_text(given)
    (root / "true.toml").write_text('base = "plain.toml"\n[tool]\nname = "quill"\nsplay = 0.1\n')
    (root / "rows.parquet").write_bytes(b"")
    new_tool(root, "quill", "round_brush", root / "told.toml", root / "true.toml", Path("rows.parquet"))
    assert load_tool(root / "src/pentimento/robots/tools/quill.toml").nominal_width_m == pytest.approx(0.009)
    assert load_world(root / WORLDS / "quill.toml").tool.splay == 0.1
    assert read_yaml(root / "params.yaml")["collect_strokes"]["source"]["quill"] == "rows.parquet"


def load_tool_text(root: Path) -> str:
    return (root / "src/pentimento/robots/tools/round_brush.toml").read_text()


def test_a_brush_that_nothing_paints_with_is_not_made_up_a_painting(tmp_path: Path) -> None:
    made = new_tool(copy_project(tmp_path), "quill", "flat_brush")
    assert [note.split()[0] for note in made.notes] == ["No", "The"] and "paint@quill" not in made.stages
    assert "quill" not in read_yaml(tmp_path / "params.yaml")["paint"]["settings"]


@pytest.mark.parametrize(
    ("name", "like", "world", "says"),
    [
        ("marker", "round_brush", None, "is there already"),
        ("colour", "round_brush", None, "is there already"),
        ("Quill", "round_brush", None, "small letters"),
        ("../quill", "round_brush", None, "small letters"),
        ("quill_base", "round_brush", None, "_base"),
        ("quill", "feather", None, "known are marker"),
        ("quill", "round_brush", 'base = "plain.toml"\n', "is that of round_brush"),
        ("quill", "round_brush", 'base = "plain.toml"\n[tool]\nnam = "quill"\n', "Unknown key nam"),
        ("quill", "round_brush", "torn = [", "not valid TOML"),
    ],
)
def test_what_cannot_be_set_up_changes_nothing(
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
@pytest.mark.parametrize("make", [new_tool, new_material])
def test_files_that_cannot_be_used_change_nothing(
    make: Callable[..., object], world: bytes | None, source: Path | None, says: str, tmp_path: Path
) -> None:
    root = copy_project(tmp_path)
    place, like = None, "foam" if make is new_material else "round_brush"
    if world is not None:
        place = root / "world.toml"
        place.write_bytes(world.replace(b"foam", b"plain") if make is new_tool else world)
    before = contents(root)
    with pytest.raises(ConfigError, match=says.replace("foam", like)):
        make(root, "quill", like, world=place, source=source)
    assert contents(root) == before


def test_the_command_says_what_to_do_next_and_refuses_a_second_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(copy_project(tmp_path))
    assert main(["new", "tool", "quill", "--like", "round_brush"]) == 0
    said = capsys.readouterr().out
    assert "tools/quill.toml" in said
    assert "dvc repro -s collect_strokes@quill train_stroke_dynamics@quill diagnose_gap@quill paint@quill" in said
    before = contents(tmp_path)
    assert main(["new", "tool", "quill", "--like", "round_brush"]) == 1
    assert "'quill' is there already" in capsys.readouterr().err
    assert contents(tmp_path) == before
    assert main(["new", "material", "wax", "--like", "foam"]) == 0
    assert main(["new", "material", "wax", "--like", "foam"]) == 1
    assert "'wax' is there already" in capsys.readouterr().err


def test_outside_a_project_the_command_says_where_to_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "tool", "quill", "--like", "round_brush"]) == 1
    assert "dvc.yaml does not exist" in capsys.readouterr().err and not list(tmp_path.iterdir())
