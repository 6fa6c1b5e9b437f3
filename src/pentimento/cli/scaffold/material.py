"""`pentimento new material`: something else to sculpt."""

from __future__ import annotations

from pathlib import Path

from pentimento.cli.scaffold.names import check_like, check_name
from pentimento.cli.scaffold.pipeline_files import (
    add_entry,
    add_paths,
    add_to_commands,
    add_to_matrices,
    open_pipeline,
    run_for,
    set_entry,
    set_source,
)
from pentimento.cli.scaffold.tool import Made
from pentimento.cli.scaffold.worlds import check_said, text_of, world_file, world_like
from pentimento.cli.scaffold.write import write_all
from pentimento.contracts.errors import ConfigError
from pentimento.robots.end_effectors import load_end_effector
from pentimento.studio.clay.world import CLAY_WORLDS, load_clay_world

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
    presses = end_effector or params.needed("collect_pushes", "end_effector").get(like)
    load_end_effector(presses)
    place = world_file(root, CLAY_WORLDS, name)
    if world is not None and place.exists():
        raise ConfigError(f"{place} exists: leave --world out to use it, or choose another name than {name!r}.")

    set_source(files, "collect_pushes", root, like, name, source)
    set_entry(params, ("collect_pushes", "world"), like, name, name)
    set_entry(params, ("collect_pushes", "end_effector"), like, name, presses)
    add_entry(files, ("sculpt", "settings"), like, name, world=name, end_effector=presses)
    add_entry(files, ("deploy", "clays"), like, name)
    stages = add_to_matrices(dvc, "material", like, name)
    add_to_commands(dvc, ("deploy",), "--materials", like, name)
    add_to_commands(dvc, ("report",), "--sculpted", like, name)
    add_paths(dvc, _READERS, _OF_A_MATERIAL, like, name)

    contents = files.contents()
    if not place.exists():
        truth = world_like("material", like, like, name) if world is None else text_of(world)
        contents = {place: truth} | contents
    write_all(contents, lambda: check_said("world", load_clay_world(place).material.name, name))
    return Made(tuple(contents), tuple(f"{stage}@{name}" for stage in stages), ())
