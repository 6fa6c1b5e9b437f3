"""`pentimento new`: a tool or material set up like an existing one; see docs/new_brush.md.

A tool is a tool file and a world file; a material is a world file. Its name is added to lists in dvc.yaml, and its
entries in params.yaml refer to those of the existing one as presets.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pentimento.cli import Command, option, workshop
from pentimento.cli.pipeline_files import ProjectFiles, names_in, text_of
from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError

TOOLS = Path("src/pentimento/robots/tools")
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
_SOURCE = Path(__file__).resolve().parents[2]


class Created(NamedTuple):
    """The result of `pentimento new`."""

    files: tuple[Path, ...]
    """Files that were written or changed."""
    stages: tuple[str, ...]
    """Stages of the new tool or material, as DVC names them, in their order."""
    notes: tuple[str, ...]
    """What could not be set up, as sentences."""


def new_tool(
    root: Path,
    name: str,
    like: str,
    *,
    tool_file: Path | None = None,
    world: Path | None = None,
    source: Path | None = None,
) -> Created:
    """Set up the tool `name` in the project in `root` like the tool `like`.

    Args:
        tool_file: the robot's description of it; by default a copy of that of `like`.
        world: the studio's hidden truth; by default that of `like`, by reference.
        source: a measured table in the strokes contract; by default the studio's robot collects strokes.

    Raises:
        ConfigError: the name is taken or invalid, or a file cannot be used; then nothing is changed.
    """
    from pentimento.robots.tools import load_tool
    from pentimento.studio.strokes.world import WORLDS, load_world

    project, notes = ProjectFiles(root), list[str]()
    _check_like(like, "tool", names_in(project.dvc, "tools"))
    paths = root / TOOLS / f"{name}.toml", _world_file(root, WORLDS, name)
    taken = [*names_in(project.dvc, "tools"), *names_in(project.dvc, "paintings")]
    _check_name(name, "tool", [*taken, *(path.stem for path in paths if path.exists())])
    description = _renamed_tool(root / TOOLS / f"{like}.toml", like, name) if tool_file is None else text_of(tool_file)
    truth = (
        _world_like("tool", _world_of(project, "collect_strokes", like), like, name)
        if world is None
        else text_of(world)
    )

    project.set_source("collect_strokes", name, source)
    stages = project.stages_for("tools")
    project.add_name("tools", name)
    painting, bundled = (_setting_of(project.parsed(stage, "settings"), like) for stage in ("paint", "deploy"))
    if painting is None:
        notes.append(f"No setting of paint uses {like}, so none uses {name}: add one to paint.settings.")
    else:
        entry = f"{name}: {{preset: paint.settings.{painting}, tool: {name}, world: {name}}}"
        project.add_entry("paint", "settings", entry)
        stages += project.stages_for("paintings")
        project.add_name("paintings", name)
    if bundled is None:
        notes.append(f"The bundle has no {like}, so it has no {name}: add a setting to deploy.settings.")
    else:
        project.add_entry("deploy", "settings", f"{name}: {{preset: deploy.settings.{bundled}, tool: {name}}}")
    if painting is not None or bundled is not None:
        project.add_name("painters", name)

    contents = dict(zip(paths, (description, truth), strict=True)) | project.contents()
    _write_all(contents, lambda: _check_named(name, load_tool(paths[0]).name, load_world(paths[1]).tool.name))
    return Created(tuple(contents), tuple(f"{stage}@{name}" for stage in stages), tuple(notes))


def new_material(
    root: Path,
    name: str,
    like: str,
    *,
    end_effector: str | None = None,
    world: Path | None = None,
    source: Path | None = None,
) -> Created:
    """Set up the material `name` in the project in `root` like the material `like`.

    Args:
        end_effector: a name or a file; by default the one that presses `like`.
        world: the studio's hidden truth; by default the shipped world of that name, or that of `like` by reference.
        source: a measured table in the pushes contract; by default the studio's robot collects pushes.

    Raises:
        ConfigError: the name is taken or invalid, or a file cannot be used; then nothing is changed.
    """
    from pentimento.robots.tools import load_end_effector
    from pentimento.studio.clay.world import CLAY_WORLDS, load_clay_world

    project = ProjectFiles(root)
    materials = names_in(project.dvc, "materials")
    _check_like(like, "material", materials)
    _check_name(name, "material", materials)
    pressing = end_effector or project.parsed("collect_pushes", "end_effector")[like]
    load_end_effector(pressing)
    place = _world_file(root, CLAY_WORLDS, name)
    if world is not None and place.exists():
        raise ConfigError(f"{place} exists: leave --world out to use it, or choose another name than {name!r}.")

    project.set_source("collect_pushes", name, source)
    project.add_entry("collect_pushes", "end_effector", f"{name}: {pressing}")
    sculpture = f"{name}: {{preset: sculpt.settings.{like}, world: {name}, end_effector: {pressing}}}"
    project.add_entry("sculpt", "settings", sculpture)
    project.add_entry("deploy", "clays", f"{name}: {{preset: deploy.clays.{like}}}")
    stages = project.stages_for("materials")
    project.add_name("materials", name)

    contents = project.contents()
    if not place.exists():
        truth = _world_like("material", _world_of(project, "collect_pushes", like), like, name)
        contents = {place: truth if world is None else text_of(world)} | contents
    _write_all(contents, lambda: _check_named(name, load_clay_world(place).material.name))
    return Created(tuple(contents), tuple(f"{stage}@{name}" for stage in stages), ())


def _check_name(name: str, what: str, taken: Collection[str]) -> None:
    if _NAME.fullmatch(name) is None or name.endswith("_"):
        raise ConfigError(
            f"{name!r} cannot name a {what}: write small letters, digits and underscores, a letter first, such as "
            "angled_brush."
        )
    if name.endswith("_base") or name.startswith("push_"):
        raise ConfigError(
            f"{name!r} cannot name a {what}: a name that ends in _base or begins with push_ belongs to other "
            "folders of models; choose another name."
        )
    if name in taken:
        raise ConfigError(f"{name!r} exists already: nothing was changed. Choose another name for the new {what}.")


def _check_like(like: str, what: str, known: Collection[str]) -> None:
    if like not in known:
        raise ConfigError(f"The pipeline has no {what} {like!r} to follow; known are {', '.join(known)}.")


def _check_named(name: str, *found: str) -> None:
    """Raise ConfigError where a written file names another tool or material."""
    for other in found:
        if other != name:
            raise ConfigError(f'A given file is that of {other}; write name = "{name}" into it. Nothing was changed.')


def _setting_of(settings: Mapping[str, Any], tool: str) -> str | None:
    """The first setting that names a tool."""
    return next((key for key, setting in settings.items() if setting.get("tool") == tool), None)


def _renamed_tool(path: Path, like: str, name: str) -> str:
    """A tool file under another name. Its comments may describe the other tool, so its first line names the source."""
    text, found = re.subn(rf'(?m)^name = "{like}"', f'name = "{name}"', text_of(path))
    if found != 1:
        raise ConfigError(f'{path} has no line name = "{like}" to change; give a tool file with --tool-file.')
    return f"# {name}: a copy of {like}'s file. Replace the values by those from the package or a measurement.\n{text}"


def _world_of(project: ProjectFiles, stage: str, like: str) -> str:
    """The name of the world in which a tool or material is used."""
    base = str(project.parsed(stage, "world").get(like, like))
    if base.endswith(".toml"):
        raise ConfigError(f"The world of {like} is the file {base}; give the new one's with --world.")
    return base


def _world_file(root: Path, worlds: Path, name: str) -> Path:
    """Where a world lies in the project; `worlds` is the folder of such worlds in this package."""
    return root / "src" / worlds.relative_to(_SOURCE) / f"{name}.toml"


def _world_like(table: str, base: str, like: str, name: str) -> str:
    """A world file that refers to the world `base`; `table` is the TOML table with the name."""
    return (
        f"# {name} in the studio: the same as {like}. Change the true values here; the robot does not read them.\n"
        f'base = "{base}.toml"\n\n[{table}]\nname = "{name}"\n'
    )


def _write_all(contents: Mapping[Path, str], check: Callable[[], None]) -> None:
    """Write files and check the result; if anything raises, restore every file."""
    before = {path: path.read_bytes() if path.exists() else None for path in contents}
    try:
        for path, text in contents.items():
            atomic_write(path, text.encode())
        check()
    except BaseException:
        for path, old in before.items():
            if old is None:
                path.unlink(missing_ok=True)
            else:
                atomic_write(path, old)
        raise


def _run_tool(arguments: argparse.Namespace) -> None:
    with workshop("set up a tool"):
        created = new_tool(
            Path.cwd(),
            arguments.name,
            arguments.like,
            tool_file=arguments.tool_file,
            world=arguments.world,
            source=arguments.source,
        )
    _print_created(arguments.name, arguments.like, created)
    print(
        f"""Collection, training, diagnosis and a painting take about five minutes on two cores.
Whether the strokes are enough: pentimento enough data/strokes/{arguments.name}
What they hold, and which causes they cannot distinguish: pentimento card data/strokes/{arguments.name}
What the model gets wrong, and why: data/gap/{arguments.name}/report.html"""
    )


def _run_material(arguments: argparse.Namespace) -> None:
    with workshop("set up a material"):
        created = new_material(
            Path.cwd(),
            arguments.name,
            arguments.like,
            end_effector=arguments.end_effector,
            world=arguments.world,
            source=arguments.source,
        )
    _print_created(arguments.name, arguments.like, created)
    print("Collection, training, diagnosis and sculpting take about ten minutes on two cores.")


def _print_created(name: str, like: str, created: Created) -> None:
    print(f"{name} is set up like {like}, in:")
    for path in created.files:
        print(f"  {path.relative_to(Path.cwd())}")
    for note in created.notes:
        print(note)
    paints = any(stage.startswith("paint@") for stage in created.stages)
    needs = ", with the models of the other tools there, which `paint` needs (`make repro` once)" if paints else ""
    print(
        f"""Read the first ones, and correct what differs. Then{needs}:
  dvc repro -s {" ".join(created.stages)}
and `make repro` for bundle and report; the others' stages run again once, because they depend on the same folders."""
    )


_COMMON = (
    option("name", metavar="NAME", help="small letters, digits, underscores"),
    option("--world", type=Path, metavar="FILE", help="the studio's hidden truth (TOML); by default as of the other"),
    option(
        "--source", type=Path, metavar="TABLE", help="measured rows: Parquet in the contract, or a folder of shards"
    ),
)

COMMAND = Command(
    "new",
    "set up a new brush or material like an existing one",
    subcommands=(
        Command(
            "tool",
            "a brush or a pen",
            (
                option("--like", required=True, metavar="TOOL", help="of the pipeline: what differs is learned"),
                option(
                    "--tool-file",
                    type=Path,
                    metavar="FILE",
                    help="the robot's description of it (TOML); by default that of TOOL",
                ),
                *_COMMON,
            ),
            _run_tool,
        ),
        Command(
            "material",
            "something to sculpt",
            (
                option("--like", required=True, metavar="MATERIAL", help="of the pipeline: what differs is learned"),
                option("--end-effector", metavar="NAME", help="what presses it; by default as for MATERIAL"),
                *_COMMON,
            ),
            _run_material,
        ),
    ),
)
