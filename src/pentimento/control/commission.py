"""What a painting or a sculpture was asked to be: written once, when it is begun, so that resuming needs nothing but
its folder.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.codec import from_plain, to_plain
from pentimento.contracts.errors import ContractError

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


@dataclass(frozen=True)
class ClayCommission:
    """What a sculpture was asked to be."""

    bundle: str
    """Its folder."""
    digest: str
    """SHA-256 of its manifest."""
    material: str
    world: str
    """The studio's."""
    letter: str
    reach_m: float
    """The letter's deepest place lies so far below the clay's mean height."""
    actions: int
    """At most."""
    seed: int


def write_commission(folder: Path, commission: Commission | ClayCommission) -> None:
    """Write it into the painting's, or the sculpture's, folder.

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
    return from_plain(Commission, _read(folder), str(Path(folder) / _NAME))


def read_clay_commission(folder: Path) -> ClayCommission | None:
    """The sculpture's commission; None where the folder is a painting's.

    Raises:
        ContractError: there is none of either, or it is damaged.
    """
    plain = _read(folder)
    if not isinstance(plain, dict) or "material" not in plain:
        return None
    return from_plain(ClayCommission, plain, str(Path(folder) / _NAME))


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


def _read(folder: Path) -> Any:
    path = Path(folder) / _NAME
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise ContractError(f"{folder} holds no {_NAME}: no painting was begun there.") from error
    except ValueError as error:
        raise ContractError(f"{path} is damaged ({error}); begin the painting anew.") from error
