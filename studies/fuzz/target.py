"""One reader whose files are altered."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple


class Target(NamedTuple):
    """One reader."""

    name: str
    sound: tuple[bytes, ...]
    """Files that it reads without complaint."""
    attempt: Callable[[bytes], Any]
    """Reads a file's bytes as the project would; raises where it refuses them."""
    must_refuse: bool = False
    """No altered byte may pass."""


def through_file(path: Path, read: Callable[[Path], Any]) -> Callable[[bytes], Any]:
    """Write the bytes to a file, and read that."""

    def attempt(data: bytes) -> Any:
        path.write_bytes(data)
        return read(path)

    return attempt
