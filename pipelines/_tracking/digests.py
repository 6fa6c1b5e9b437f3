"""By what data and parameters are known to be the same."""

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipelines._tracking.dvc_lock import locked_stages


def input_digest(path: Path) -> str:
    """Return the MD5 by which DVC knows `path`, or an MD5 of its files where DVC does not track it."""
    for stage in locked_stages(Path()).values():
        for out in stage.get("outs", []):
            if Path(out["path"]) == path:
                return str(out["md5"])
    if path.is_file():
        return md5(path.read_bytes())
    if not path.is_dir():
        raise FileNotFoundError(2, os.strerror(2), str(path))
    files = sorted(file for file in path.rglob("*") if file.is_file())
    return md5("\n".join(f"{file.relative_to(path)} {md5(file.read_bytes())}" for file in files).encode())


def section_digest(section: Any) -> str:
    """Return an MD5 of a section of params.yaml as it is written there, which dvc.lock repeats."""
    return md5(json.dumps(section, sort_keys=True, default=str).encode())


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested mappings as one, their names joined by dots."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def md5(content: bytes) -> str:
    """As DVC counts."""
    return hashlib.md5(content, usedforsecurity=False).hexdigest()
