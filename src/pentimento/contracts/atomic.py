"""Writing that either happens completely or leaves what was there: files and folders.

The new content is made beside the old under a hidden name on the same file system, flushed to the
disk, and renamed over the old. Whatever goes wrong before the rename (an exception, a full disk, a
killed process) leaves the old content in its place.
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

    The parent folder is made if it is missing. Raises OSError; then the old file is untouched.
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

    When the block, the flush or the rename raises, the temporary folder is removed and the old folder
    stays. A folder cannot be exchanged in one step: between two renames the old one bears the name
    `.<name>.old`; if the machine dies just there, the next call puts it back first.
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
    """Rename `new` to `path`; what stood there becomes `old`, and comes back if the rename fails."""
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
