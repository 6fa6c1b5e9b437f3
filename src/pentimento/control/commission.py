"""The commission of a painting or a sculpture, written when it is begun, so that its folder suffices to resume it."""

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
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.ranges import at_least
from pentimento.control.expression import PLAIN, Expression

_NAME: Final = "commission.json"


@dataclass(frozen=True)
class Wanted:
    """The source of the goal picture, or the drawing that is the plan."""

    kind: Literal["picture", "words", "drawing"]
    value: str
    """A picture's or an SVG drawing's file, or a person's words; "" asks only to complete what is on the canvas."""


@dataclass(frozen=True)
class Weights:
    """Weights of a plan's objectives; see ``planning.strokes.config.ObjectivesConfig``."""

    print: float
    semantic: float
    text: float
    """Of the words that were asked for last."""

    def __post_init__(self) -> None:
        at_least(self, 0, "print", "semantic", "text")
        if self.print + self.semantic + self.text == 0:
            raise ValueError("print, semantic and text are 0; give at least one of them a weight.")


@dataclass(frozen=True)
class Commission:
    """What was asked for in a painting."""

    bundle: str
    """Its folder."""
    digest: str
    """SHA-256 of its manifest: a painting is resumed with the same bundle only."""
    setting: str
    robot: str
    execute: bool
    """Hardware moves; otherwise the virtual robot rehearses."""
    wanted: Wanted
    strokes: int
    replan_every: int
    """Strokes between two photographs, each of which replans the rest."""
    seed: int
    weights: Weights | None = None
    """None for the objectives of the bundle's setting."""
    expression: Expression = PLAIN
    """How the words asked for are painted."""
    hand: str | None = None
    """Whose hand it begins in; None for the robot's own strokes."""


@dataclass(frozen=True)
class ClayGoal:
    """The source of a sculpture's goal."""

    kind: Literal["letter", "mesh", "heights", "image"]
    value: str
    """Letters, or a file."""
    font: str | None = None
    """File of the letters' font; None for plain strokes, and where these lack a letter for an installed font."""
    up: Literal["x", "y", "z"] | None = None
    """Axis of a mesh that points up; None is z, but an OBJ needs it."""


@dataclass(frozen=True)
class ClayCommission:
    """What was asked for in a sculpture."""

    bundle: str
    """Its folder."""
    digest: str
    """SHA-256 of its manifest."""
    material: str
    world: str
    """World of the virtual studio."""
    goal: ClayGoal
    depth_m: float
    """Depth of the goal's lowest point below the clay's mean height."""
    actions: int
    """Maximum number."""
    seed: int
    scan_pixels: int
    """Of a scan, along the slab's longer side."""
    raised_m: float = 0.0
    """Height of the goal's highest point above the clay's mean height. Above 0 the goal stands on the surface, and
    `depth_m` does not count."""
    robot: str = "virtual"
    """The studio's, or the name or path of a rig file."""
    execute: bool = False
    """Hardware moves; otherwise the studio rehearses."""


def write_commission(folder: Path, commission: Commission | ClayCommission) -> None:
    """Write the commission into a new folder.

    Raises:
        ContractError: a painting was begun there already, it holds other files, or it is not a folder.
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
    """The sculpture's commission; None where the folder holds a painting.

    Raises:
        ContractError: there is no commission, or it is damaged.
    """
    plain = _read(folder)
    if not isinstance(plain, dict) or "material" not in plain:
        return None
    return from_plain(ClayCommission, plain, str(Path(folder) / _NAME))


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """A lock on the folder while the block runs; the system releases it however the process ends.

    Raises:
        ContractError: another process holds the lock.
    """
    with (Path(folder) / _NAME).open(encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ContractError(f"Another process paints in {folder}; wait for its end, or stop it first.") from error
        yield


@contextmanager
def begun(folder: Path, commission: Commission | ClayCommission) -> Iterator[None]:
    """A new folder with a commission, as by `write_commission`, locked as by `exclusive` while the block runs.

    If the block refuses its inputs (ConfigError, ContractError), such as a rig file, before it has written anything
    else, the commission is removed, and with it a folder that did not exist: the command can be given again as it was.
    """
    is_new = not Path(folder).exists()
    write_commission(folder, commission)
    with exclusive(folder):
        try:
            yield
        except (ConfigError, ContractError):
            if [file.name for file in Path(folder).iterdir()] == [_NAME]:
                (Path(folder) / _NAME).unlink()
                if is_new:
                    Path(folder).rmdir()
            raise


def _read(folder: Path) -> Any:
    path = Path(folder) / _NAME
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise ContractError(f"{folder} holds no {_NAME}: no painting was begun there.") from error
    except ValueError as error:
        raise ContractError(f"{path} is damaged ({error}); begin a new painting.") from error
