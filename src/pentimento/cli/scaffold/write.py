"""All files of a change, or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from pentimento.contracts.atomic import atomic_write


def write_all(contents: Mapping[Path, str], check: Callable[[], None]) -> None:
    """Write files and check what came of it; whatever is raised meanwhile, every file is again as it was."""
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
