"""dvc.yaml and dvc.lock, and the MD5 digests by which DVC compares data and parameters."""

import fcntl
import hashlib
import json
import os
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

from pipelines._params import Params, read_yaml, sections_of


def matrix_items(folder: Path, stage: str) -> dict[str, list[str]]:
    """Return the items of a stage by axis of its matrix in dvc.yaml, with references to `vars` resolved."""
    return _axes(read_yaml(folder / "dvc.yaml"), stage)


def _axes(document: Params, stage: str) -> dict[str, list[str]]:
    lists = {f"${{{name}}}": listed for each in document.get("vars", []) for name, listed in each.items()}
    matrix = document.get("stages", {}).get(stage, {}).get("matrix", {})
    return {axis: lists[items] if isinstance(items, str) else items for axis, items in matrix.items()}


def outputs(folder: Path) -> list[str]:
    """Return every path that the stages of dvc.yaml write, and those that an earlier dvc.yaml wrote (by dvc.lock)."""
    found = dict.fromkeys(path for paths in outputs_by_stage(folder).values() for path in paths)
    locked = (out["path"] for stage in locked_stages(folder).values() for out in stage.get("outs", []))
    return list(found | dict.fromkeys(locked))


def outputs_by_stage(folder: Path) -> dict[str, list[str]]:
    """Return the paths that each stage item of dvc.yaml writes, by the item's name as DVC writes it."""
    document, found = read_yaml(folder / "dvc.yaml"), dict[str, list[str]]()
    for name, stage in document.get("stages", {}).items():
        paths = [out if isinstance(out, str) else next(iter(out)) for out in stage.get("outs", [])]
        axes = _axes(document, name)
        for items in product(*axes.values()):
            values = dict(zip(axes, items, strict=True))
            found["@".join(filter(None, (name, "-".join(items))))] = [_filled(path, values) for path in paths]
    return found


def _filled(path: str, values: Mapping[str, str]) -> str:
    """Return a path of dvc.yaml with the item of each axis in place of its reference."""
    for axis, item in values.items():
        path = path.replace(f"${{item.{axis}}}", item)
    return path


def locked_stages(folder: Path) -> dict[str, Any]:
    """Return the entries of dvc.lock in `folder` by stage item; empty where no stage has run yet.

    DVC empties the file before it writes it, and another stage may end at any moment. The file is therefore read under
    DVC's own lock, which DVC holds while it writes and releases while a stage runs.
    """
    file = folder / "dvc.lock"
    if not file.is_file():
        return {}
    lock = folder / ".dvc/tmp/lock"
    if not lock.is_file():  # no DVC ever ran here
        return _stages(file)
    with lock.open(encoding="utf-8") as held:
        fcntl.flock(held, fcntl.LOCK_SH)
        return _stages(file)


def _stages(file: Path) -> dict[str, Any]:
    stages: dict[str, Any] = read_yaml(file).get("stages", {})
    return stages


def input_digests(inputs: Mapping[str, Path]) -> dict[str, str]:
    """Return DVC's MD5 of each path, or an MD5 of its files where DVC does not track it."""
    outs = (out for stage in locked_stages(Path()).values() for out in stage.get("outs", []))
    tracked = {Path(out["path"]): str(out["md5"]) for out in outs}
    return {name: tracked.get(path) or _digest_of_files(path) for name, path in inputs.items()}


def _digest_of_files(path: Path) -> str:
    if path.is_file():
        return md5(path.read_bytes())
    if not path.is_dir():
        raise FileNotFoundError(2, os.strerror(2), str(path))
    files = sorted(file for file in path.rglob("*") if file.is_file())
    return md5("\n".join(f"{file.relative_to(path)} {md5(file.read_bytes())}" for file in files).encode())


def params_digest(stage: str, params: dict[str, Any]) -> str:
    """Return an MD5 of the sections of params.yaml that a stage depends on, as dvc.lock repeats them."""
    return value_digest({name: params[name] for name in sections_of(stage, params)})


def value_digest(value: Any) -> str:
    """Return an MD5 of a value that JSON can hold."""
    return md5(json.dumps(value, sort_keys=True, default=str).encode())


def md5(content: bytes) -> str:
    """Return an MD5 as DVC writes it."""
    return hashlib.md5(content, usedforsecurity=False).hexdigest()


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested mappings as one, with their keys joined by dots."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat
