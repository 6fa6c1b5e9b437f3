"""Atomic writing of files and folders: a write either completes or leaves the old content.

The new content is written under a hidden name in the same folder, flushed to the disk, and renamed over the old. A
failure before the rename (an exception, a full disk, a killed process) leaves the old content.
"""

import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def _sibling(path: Path, ending: str) -> Path:
    return path.with_name(f".{path.name}.{ending}")


def _sync(path: Path) -> None:
    """Flush a file or a folder's entries to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def atomic_write(path: Path, data: bytes) -> None:
    """Write a file so that a reader sees the old content or the new, never a part.

    A missing parent folder is created. Raises OSError; then the old file is untouched.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = _sibling(path, f"{uuid.uuid4().hex[:8]}.tmp")
    try:
        temporary.write_bytes(data)
        _sync(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    _sync(path.parent)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """A temporary sibling folder that becomes `path` (in place of an old one) when the block ends well.

    When the block, the flush or the rename raises, the temporary folder is removed and the old folder stays. A folder
    cannot be exchanged in one step: between two renames the old one has the name `.<name>.old`. If the machine stops
    there, the next call first restores it.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    old = _sibling(path, "old")
    if old.exists() and not path.exists():
        old.rename(path)
    temporary = _sibling(path, f"{uuid.uuid4().hex[:8]}.tmp")
    temporary.mkdir()
    try:
        yield temporary
        for entry in sorted(temporary.rglob("*")):
            if not entry.is_symlink():
                _sync(entry)
        _sync(temporary)
        _exchange(temporary, path, old)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    if old.is_file():  # a file stood where the folder belongs
        old.unlink()
    shutil.rmtree(old, ignore_errors=True)
    _sync(path.parent)


def _exchange(new: Path, path: Path, old: Path) -> None:
    """Rename `new` to `path`; the content there becomes `old`, and is restored if the rename fails."""
    if old.exists():
        shutil.rmtree(old)
    if not path.exists():
        new.rename(path)
        return
    path.rename(old)
    try:
        new.rename(path)
    except OSError:
        old.rename(path)
        raise
