"""`pentimento new material`: something else to sculpt."""

from __future__ import annotations

from pathlib import Path

from pentimento.contracts.errors import ConfigError
from pentimento.robots.end_effectors import load_end_effector
from pentimento.scaffold.names import check_like, check_name
from pentimento.scaffold.pipeline_files import (
    add_entry,
    add_paths,
    add_to_commands,
    add_to_matrices,
    open_pipeline,
    run_for,
    set_entry,
)
from pentimento.scaffold.tool import Made
from pentimento.scaffold.write import write_all
from pentimento.studio.clay.world import CLAY_WORLDS, load_clay_world

_PACKAGE = Path(__file__).resolve().parents[1]
_OF_A_MATERIAL = (
    "data/pushes/{}",
    "models/push_{}_base/weights",
    "models/push_{}/weights",
    "data/gap/push_{}",
    "data/sculptures/{}",
)
_READERS = ("deploy", "report")


def new_material(
    root: Path,
    name: str,
    like: str,
    end_effector: str | None = None,
    world: Path | None = None,
    source: Path | None = None,
) -> Made:
    """Set up the material ``name`` in the project in ``root``, in every place where ``like`` stands.

    Args:
        end_effector: a name or a file; by default what presses ``like``.
        world: the studio's hidden truth; by default the shipped world of that name, or else ``like``'s by reference.
        source: pushes that were measured, in the pushes contract; by default the studio's robot makes them.

    Raises:
        ConfigError: the name is taken or is none, or a file cannot be used; then nothing is changed.
    """
    files = open_pipeline(root)
    dvc, params = files.dvc, files.params
    check_like(like, "material", run_for(dvc, "material"))
    check_name(name, "material", run_for(dvc, "material"))
    if source is not None and not (root / source).exists():
        raise ConfigError(f"--source: {root / source} does not exist; give a Parquet file or a folder of shards.")
    presses = end_effector or params.needed("collect_pushes", "end_effector").get(like)
    load_end_effector(presses)
    place = root / "src" / CLAY_WORLDS.relative_to(_PACKAGE.parent) / f"{name}.toml"
    if world is not None and place.exists():
        raise ConfigError(f"{place} exists: leave --world out to use it, or choose another name than {name!r}.")

    for key, value in (
        ("source", None if source is None else str(source)),
        ("world", name),
        ("end_effector", presses),
    ):
        set_entry(params, ("collect_pushes", key), like, name, value)
    add_entry(files, ("sculpt", "settings"), like, name, world=name, end_effector=presses)
    add_entry(files, ("deploy", "clays"), like, name)
    stages = add_to_matrices(dvc, "material", like, name)
    add_to_commands(dvc, ("deploy",), "--materials", like, name)
    add_to_commands(dvc, ("report",), "--sculpted", like, name)
    add_paths(dvc, _READERS, _OF_A_MATERIAL, like, name)

    contents = files.contents()
    if not place.exists():
        contents = {place: _world_like(like, name) if world is None else world.read_text(encoding="utf-8")} | contents
    write_all(contents, lambda: _check(place, name))
    return Made(tuple(contents), tuple(f"{stage}@{name}" for stage in stages), ())


def _world_like(like: str, name: str) -> str:
    return (
        f"# {name} in the studio: as {like}. Change here how it really yields; the robot is never told.\n"
        f'base = "{like}.toml"\n\n[material]\nname = "{name}"\n'
    )


def _check(world: Path, name: str) -> None:
    said = load_clay_world(world).material.name
    if said != name:
        raise ConfigError(f'The world is that of {said}; write name = "{name}" below [material]. Nothing was changed.')
