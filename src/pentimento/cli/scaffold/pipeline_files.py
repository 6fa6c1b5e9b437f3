"""dvc.yaml, params.yaml and the profiles: where a tool, a setting or a material stands in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pentimento.cli.scaffold.project_yaml import ProjectYaml, add_copy, add_item, with_option
from pentimento.contracts.errors import ConfigError


class PipelineFiles(NamedTuple):
    """The YAML files of a project's folder."""

    dvc: ProjectYaml
    params: ProjectYaml
    profiles: tuple[ProjectYaml, ...]

    def contents(self) -> dict[Path, str]:
        """Path and text of each, as they are to be written."""
        return {file.path: file.text() for file in (*self.profiles, self.params, self.dvc)}


def open_pipeline(root: Path) -> PipelineFiles:
    """Read the YAML files of the project in ``root``.

    Raises ConfigError where one is missing or unreadable.
    """
    profiles = tuple(ProjectYaml(path) for path in sorted((root / "profiles").glob("*.yaml")))
    return PipelineFiles(ProjectYaml(root / "dvc.yaml"), ProjectYaml(root / "params.yaml"), profiles)


def run_for(dvc: ProjectYaml, key: str) -> list[str]:
    """All tools, settings or materials (the matrices' ``key``) that some stage runs for, in their order."""
    named = [
        name for stage in dvc.needed("stages").values() for name in (stage.get("matrix") or {}).get(key, ())
    ]  # fmt: skip
    return list(dict.fromkeys(named))


def add_to_matrices(dvc: ProjectYaml, key: str, like: str, name: str, only: Sequence[str] | None = None) -> list[str]:
    """Let every stage (or those named in ``only``) that runs for ``like`` run for ``name``; returns the stages."""
    stages = []
    for stage, entry in dvc.needed("stages").items():
        named = (entry.get("matrix") or {}).get(key, ())
        if like in named and (only is None or stage in only):
            add_item(named, like, name)
            stages.append(stage)
    return stages


def add_to_commands(dvc: ProjectYaml, stages: Sequence[str], option: str, like: str, name: str) -> None:
    """Name ``name`` after ``like`` in an option of the stages' commands."""
    for stage in stages:
        entry = dvc.needed("stages", stage)
        entry["cmd"] = with_option(entry["cmd"], option, like, name)


def add_paths(dvc: ProjectYaml, stages: Sequence[str], templates: Sequence[str], like: str, name: str) -> None:
    """Where a stage depends on a folder of ``like``, or a metric is one of its files, add the same of ``name``."""
    lists = [dvc.needed("stages", stage, "deps") for stage in stages]
    for template in templates:
        for paths in lists:
            if template.format(like) in paths:
                add_item(paths, template.format(like), template.format(name))
        metric = f"{template}/metrics.json"
        if metric.format(like) in dvc.needed("metrics"):
            add_item(dvc.needed("metrics"), metric.format(like), metric.format(name))


def add_entry(files: PipelineFiles, keys: Sequence[str], like: str, name: str, **changed: object) -> None:
    """Copy the entry ``like`` of a section of params.yaml as ``name``, with some of its values changed.

    Profiles that say something of ``like`` there say the same of ``name``.
    """
    for file in (files.params, *files.profiles):
        entries = file.at(*keys)
        if entries is None or like not in entries or name in entries:
            continue
        copied = add_copy(entries, like, name)
        if file is files.params:
            for key, value in changed.items():
                if key not in copied:
                    raise ConfigError(f"{file.path}: {'.'.join(keys)}.{like} has no {key}, which {name} needs.")
                copied[key] = value


def set_entry(params: ProjectYaml, keys: Sequence[str], like: str, name: str, value: str | None) -> None:
    """Put ``name: value`` after ``like`` into a section that has one value for each tool or material."""
    entries = params.needed(*keys)
    if name in entries:
        entries[name] = value
        return
    if like not in entries:
        raise ConfigError(f"{params.path}: {'.'.join(keys)} has no entry {like!r} to follow; add it.")
    add_copy(entries, like, name)
    entries[name] = value


def set_source(files: PipelineFiles, stage: str, root: Path, like: str, name: str, source: Path | None) -> None:
    """Say from where the stage takes the rows of ``name``: from a table, or (None) from the studio's robot.

    Raises ConfigError where there is no such table.
    """
    if source is not None and not (root / source).exists():
        raise ConfigError(f"--source: {root / source} does not exist; give a Parquet file or a folder of shards.")
    set_entry(files.params, (stage, "source"), like, name, None if source is None else str(source))
