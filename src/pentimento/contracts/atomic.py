"""Atomic writing of files and folders: a write either completes or leaves the old content.

The new content is written under a hidden name in the same folder, flushed to the disk, and renamed over the old. A
failure before the rename (an exception, a full disk, a killed process) leaves the old content.
"""

import errno
import hashlib
import json
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from pentimento.contracts.errors import ConfigError

_CANNOT: Final = (errno.EINVAL, errno.ENOTSUP)
"""Errors of file systems without the flush of a folder."""
RECORD: Final = ".pentimento.json"
"""In a folder that a command wrote: the command, and a digest of each file."""


def _sibling(path: Path, ending: str) -> Path:
    return path.with_name(f".{path.name}.{ending}")


def _sync(path: Path) -> None:
    """Flush a file, or a folder's entries where the file system can: some shares and shared folders cannot."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in _CANNOT or not path.is_dir():
            raise
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


@contextmanager
def command_folder(path: Path, command: str) -> Iterator[Path]:
    """As `atomic_folder`, but it replaces only what the same command wrote and nobody changed.

    Args:
        command: the command that writes the folder, as its users call it.

    Raises:
        ConfigError: see `check_replaceable`.
    """
    check_replaceable(path, command)
    with atomic_folder(Path(os.path.abspath(path))) as folder:
        yield folder
        record = {"command": command, "files": _digests(folder)}
        (folder / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def add_to_record(folder: Path, name: str) -> None:
    """Let the command that wrote a folder replace a file that another command added to it, too.

    A folder without a record, which no command wrote, stays as it is.
    """
    record = _record(folder)
    if isinstance(record.get("files"), dict):
        record["files"][name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        atomic_write(folder / RECORD, (json.dumps(record, indent=1) + "\n").encode())


def check_replaceable(path: Path, command: str) -> None:
    """Let a command replace a folder only if it does not exist, is empty, or holds just what the command wrote.

    Raises:
        ConfigError: something else would be deleted.
    """
    check_place(path)
    place = Path(os.path.abspath(path))
    if place.is_symlink():
        raise ConfigError(f"{path} is a link; give the folder itself.")
    if not place.exists() or (place.is_dir() and not any(place.iterdir())):
        return
    if not place.is_dir():
        raise ConfigError(f"{path} is a file, which would be deleted; give the name of a new folder.")
    known, present = _recorded(place, command), _digests(place)
    other = next((name for name, digest in present.items() if known.get(name) != digest), None)
    if other is not None:
        what = "was changed since" if other in known else f"`{command}` did not write"
        raise ConfigError(
            f"{path} holds {other}, which {what}; it would be deleted. Name a new folder, or remove that one."
        )


def command_page(path: Path, text: str, command: str) -> None:
    """Write an HTML or Markdown file; replace a file only if the same command wrote it and nobody changed it.

    A comment at its end names the command and holds a digest of the file above it.

    Raises:
        ConfigError: another file would be replaced.
    """
    path = Path(path)
    if path.is_dir():
        raise ConfigError(f"{path} is a folder; give the name of a new file.")
    if path.exists():
        old, mark, _ = path.read_bytes().rpartition(b"\n<!-- ")
        if not mark or path.read_bytes() != _marked(old, command):
            raise ConfigError(
                f"{path} was not written by `{command}`, or was changed since, and would be replaced; name a new file."
            )
    atomic_write(path, _marked(text.encode(), command))


def _marked(content: bytes, command: str) -> bytes:
    return content + f"\n<!-- {command} {hashlib.sha256(content).hexdigest()} -->\n".encode()


def check_place(path: Path) -> None:
    """Refuse to write a folder where a command runs, or around that place.

    Raises:
        ConfigError: it is such a place.
    """
    here = Path.cwd().resolve()
    if Path(path).resolve() in (here, *here.parents):
        raise ConfigError(f"{path} holds the folder in which you are; give the name of a new folder.")


def _recorded(folder: Path, command: str) -> dict[str, str]:
    """The digests of the files that a command wrote into a folder; empty where it did not write it."""
    record = _record(folder)
    if record.get("command") != command or not isinstance(record.get("files"), dict):
        return {}
    files: dict[str, str] = record["files"]
    return files


def _record(folder: Path) -> dict[str, Any]:
    """The record of a folder; empty where there is none, or another file has its name."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def _digests(folder: Path) -> dict[str, str]:
    """A digest of each file below a folder but its record, by path; an empty folder counts as a file."""
    found = {}
    for entry in sorted(folder.rglob("*")):
        name = entry.relative_to(folder).as_posix()
        if entry.is_symlink() or not (entry.is_file() or entry.is_dir()):
            found[name] = "another kind of file"
        elif entry.is_dir():
            found |= {} if any(entry.iterdir()) else {name: "an empty folder"}
        elif name != RECORD:
            with entry.open("rb") as file:
                found[name] = hashlib.file_digest(file, "sha256").hexdigest()
    return found
