"""What a painting was asked to be: written once, when it is begun, so that resuming needs nothing but its folder."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ContractError
from pentimento.runner.plain import from_plain, to_plain

_NAME: Final = "commission.json"


@dataclass(frozen=True)
class Wanted:
    """What is to be seen."""

    kind: Literal["picture", "words"]
    value: str
    """A picture's file; or what a person asks for, "" for what is begun to be completed."""


@dataclass(frozen=True)
class Commission:
    """What a painting was asked to be."""

    bundle: str
    """Its folder."""
    digest: str
    """SHA-256 of its manifest: a painting is finished with the bundle that it was begun with."""
    setting: str
    robot: str
    execute: bool
    """Hardware moves; otherwise it is rehearsed."""
    wanted: Wanted
    strokes: int
    batch: int
    seed: int


def write_commission(folder: Path, commission: Commission) -> None:
    """Write it into the painting's folder.

    Raises:
        ContractError: a painting was begun there already, it holds something else, or it is no folder.
    """
    path = Path(folder) / _NAME
    if path.exists():
        raise ContractError(f"A painting was begun in {folder}; go on with --resume {folder}, or give another folder.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise ContractError(f"{folder} cannot be a painting's folder: a file is in its place; give another.") from error
    if any(path.parent.iterdir()):
        raise ContractError(f"{folder} holds other files already, which a painting could replace; give a new folder.")
    atomic_write(path, (json.dumps(to_plain(commission), indent=2) + "\n").encode())


def read_commission(folder: Path) -> Commission:
    """The painting's commission.

    Raises:
        ContractError: there is none, or it is damaged.
    """
    path = Path(folder) / _NAME
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise ContractError(f"{folder} holds no {_NAME}: no painting was begun there.") from error
    except ValueError as error:
        raise ContractError(f"{path} is damaged ({error}); begin the painting anew.") from error
    return from_plain(Commission, plain, str(path))


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """While the block runs, no other process paints in the folder. However this one ends, the next one may.

    Raises:
        ContractError: another one does.
    """
    with (Path(folder) / _NAME).open() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ContractError(f"Another process paints in {folder}; wait for its end, or stop it first.") from error
        yield
