"""`pentimento new tool`: a brush beside those that are there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

from pentimento.cli.scaffold.names import check_like, check_name
from pentimento.cli.scaffold.pipeline_files import (
    PipelineFiles,
    add_entry,
    add_paths,
    add_to_commands,
    add_to_matrices,
    open_pipeline,
    run_for,
    set_entry,
    set_source,
)
from pentimento.cli.scaffold.worlds import check_said, text_of, world_file, world_like
from pentimento.cli.scaffold.write import write_all
from pentimento.contracts.errors import ConfigError
from pentimento.robots.tools import load_tool
from pentimento.studio.world import WORLDS, load_world

TOOLS = Path("src/pentimento/robots/tools")

_OF_A_TOOL = ("data/strokes/{}", "models/stroke_{}_base/weights", "models/stroke_{}/weights", "data/gap/{}")
_READERS = ("paint", "deploy", "report")
"""Stages that name tools in their commands and may name every one; others name those of their own settings."""


class Made(NamedTuple):
    """What was written, and what to run next."""

    files: tuple[Path, ...]
    stages: tuple[str, ...]
    """Of the new tool or material, as DVC names them, in their order."""
    notes: tuple[str, ...]


def new_tool(
    root: Path,
    name: str,
    like: str,
    tool_file: Path | None = None,
    world: Path | None = None,
    source: Path | None = None,
) -> Made:
    """Set up the tool ``name`` in the project in ``root``, in every place where ``like`` stands.

    Args:
        tool_file: what the robot is told of it; by default what it is told of ``like``.
        world: the studio's hidden truth; by default a copy of ``like``'s, by reference.
        source: strokes that were measured, in the strokes contract; by default the studio's robot makes them.

    Raises:
        ConfigError: the name is taken or is none, or a file cannot be used; then nothing is changed.
    """
    files = open_pipeline(root)
    settings = files.params.needed("paint", "settings")
    check_like(like, "tool", run_for(files.dvc, "tool"))
    paths = {"tool": root / TOOLS / f"{name}.toml", "world": world_file(root, WORLDS, name)}
    taken = [*run_for(files.dvc, "tool"), *run_for(files.dvc, "setting"), *settings]
    taken += [path.stem for path in paths.values() if path.exists()]
    check_name(name, "tool", taken)
    told = _told(root / TOOLS / f"{like}.toml", like, name) if tool_file is None else text_of(tool_file)
    truth = _world_like(files, like, name) if world is None else text_of(world)

    stages, notes = _pipeline(files, root, name, like, source)
    contents = {paths["tool"]: told, paths["world"]: truth} | files.contents()
    write_all(contents, lambda: _check(paths["tool"], paths["world"], name))
    return Made(tuple(contents), tuple(f"{stage}@{name}" for stage in stages), tuple(notes))


def _told(path: Path, like: str, name: str) -> str:
    """A tool file under another name; its comments may speak of the other tool, so that they say whose they are."""
    text, found = re.subn(rf'(?m)^name = "{like}"', f'name = "{name}"', text_of(path))
    if found != 1:
        raise ConfigError(f'{path} has no line name = "{like}" to change; give a tool file with --tool-file.')
    head = f"# {name}: a copy of {like}'s file so far. Write down what you read off the package or measure.\n"
    return head + text


def _world_like(files: PipelineFiles, like: str, name: str) -> str:
    """The hidden truth of another tool under this one's name: nothing is made up."""
    base = (files.params.at("collect_strokes", "world") or {}).get(like, like)
    if str(base).endswith(".toml"):
        raise ConfigError(f"The world of {like} is the file {base}; give the new tool's with --world.")
    return world_like("tool", base, like, name)


def _check(tool: Path, world: Path, name: str) -> None:
    check_said("tool file", load_tool(tool).name, name)
    check_said("world", load_world(world).tool.name, name)


def _pipeline(
    files: PipelineFiles, root: Path, name: str, like: str, source: Path | None
) -> tuple[list[str], list[str]]:
    """Edit the YAML files; returns the stages of the new tool, and what could not be set up."""
    dvc, params, notes = files.dvc, files.params, []
    set_source(files, "collect_strokes", root, like, name, source)
    set_entry(params, ("collect_strokes", "world"), like, name, name)
    stages = add_to_matrices(dvc, "tool", like, name)
    add_to_commands(dvc, _READERS, "--tools", like, name)
    add_paths(dvc, _READERS, _OF_A_TOOL, like, name)

    setting = _setting_of(params.needed("paint", "settings"), like)
    if setting is None:
        notes.append(f"No painting is planned with {like}, so that none is with {name}: add one to paint.settings.")
    else:
        add_entry(files, ("paint", "settings"), setting, name, tool=name, world=name)
        stages += add_to_matrices(dvc, "setting", setting, name, only=("paint",))
        add_to_commands(dvc, ("report",), "--settings", setting, name)
        add_paths(dvc, ("report",), ("data/paintings/{}",), setting, name)

    setting = _setting_of(params.needed("deploy", "settings"), like)
    if setting is None:
        notes.append(f"The bundle has no {like}, so that it has no {name}: add a setting to deploy.settings.")
    else:
        add_entry(files, ("deploy", "settings"), setting, name, tool=name)
    return stages, notes


def _setting_of(settings: Any, tool: str) -> str | None:
    """The first setting that uses a tool."""
    return next((key for key, setting in settings.items() if setting["tool"] == tool), None)
