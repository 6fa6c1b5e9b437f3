"""Checkpoints: what a painting or a sculpture needs to continue after its computer failed.

A checkpoint is one file of plain values and arrays. It is replaced as a whole after every action.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.covariates import Memory
from pentimento.contracts.errors import ContractError
from pentimento.contracts.observations import Scan
from pentimento.control.placing import as_columns, from_columns
from pentimento.control.sculptor import Outcome, SculptureProgress
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.fixed import FixedStrokes, as_rows
from pentimento.planning.strokes.latent import StyleDecoder, decoder_bytes, decoder_from
from pentimento.planning.strokes.paths import PlannedPaths
from pentimento.planning.strokes.shapes import ShapedStrokes

Arrays = dict[str, NDArray[Any]]
FloatArray = NDArray[np.float64]
HeightMap = NDArray[np.float32]
Picture = NDArray[np.uint8]
Loaded = TypeVar("Loaded")

Phase = Literal["painting", "paused", "your turn", "choosing", "undoing", "undone", "stopped", "done"]

_DAMAGE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, NotImplementedError, RuntimeError)
"""What reading a file raises that is truncated, overwritten or not a checkpoint."""

_PAINTING_SCHEMA: Final = 5
_PAINTING: Final = "state.npz"
_NUMBERS: Final = ("since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "mark_width_m", "canvas_size_m")
_PLAIN: Final = (
    "pending", "executed", "sessions", "shard", "turns", "lines", "clock_s", "robot_clock_s", "unix_s", "phase",
    "message", "hand",
)  # fmt: skip
_ARRAYS: Final = ("last_color_srgb", "painted_at_s", "ink", "color", "carried")

_SCULPTURE_SCHEMA: Final = 3
_SCULPTURE: Final = "sculpture.npz"


@dataclass(frozen=True, eq=False)
class PaintingState:
    """A painting between two strokes, or with one stroke pending."""

    remaining: PlannedPaths
    """Strokes to execute, in order."""
    pending: bool
    """The first remaining stroke was sent to the robot, which has not confirmed it."""
    palette_srgb: FloatArray
    """[K, 3] paints that are loaded, or the tool's own ink."""
    memory: Memory
    """Of tool and canvas, before the first of ``remaining``."""
    canvas: Picture
    """[H, W, 3] sRGB, as observed last."""
    goal: Picture
    """[H, W, 3] sRGB"""
    executed: int
    """Number of strokes executed so far."""
    sessions: int
    """Number of recordings so far: each start and each resumption is one."""
    shard: int
    """Number of the recording's next file."""
    turns: int
    """Number of turns that a person has had."""
    lines: int
    """Number of lines that a person has drawn on the page."""
    clock_s: float
    """Time since the painting's start."""
    robot_clock_s: float
    """The robot's clock at that time."""
    unix_s: float
    """The computer's clock at that time."""
    phase: Phase
    message: str
    """What happens, or what happened and what to do."""
    hand: str | None = None
    """Whose hand the next plan is in; None for the robot's own strokes. ``remaining`` may be in another."""


@dataclass(frozen=True, eq=False)
class SculptureState:
    """A sculpture between two actions, or with one action pending."""

    goal_m: HeightMap
    """[H, W]"""
    progress: SculptureProgress
    sessions: int
    """Number of sessions: each start and each resumption is one."""
    stopped: Outcome | None
    """Why it is done; None while it is not."""


def write_checkpoint(path: Path, schema: int, values: Mapping[str, Any], arrays: Arrays) -> None:
    """Replace the file. Raises OSError; the previous checkpoint still exists then."""
    text = json.dumps({"schema": schema, **values}).encode()
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, values=np.frombuffer(text, np.uint8), **arrays)
    atomic_write(path, content.getvalue())


def read_checkpoint(path: Path, schema: int, kind: str, build: Callable[[dict[str, Any], Arrays], Loaded]) -> Loaded:
    """The last checkpoint: ``build`` of its plain values and arrays.

    Args:
        kind: what the checkpoint is of, such as "painting"; for messages.

    Raises:
        ContractError: there is none, or it is damaged or of another version.
    """
    if not path.is_file():
        raise ContractError(f"{path.parent} holds no {path.name}: no {kind} was begun there; begin one with --out.")
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as stored:
            arrays = dict(stored)
        values: dict[str, Any] = json.loads(arrays.pop("values").tobytes())
        if values["schema"] != schema:
            raise ContractError(f"{path} is of schema {values['schema']}; this version reads schema {schema}.")
        return build(values, arrays)
    except _DAMAGE as error:
        raise ContractError(f"{path} is damaged ({error!r}); begin a new {kind}.") from error


def save_state(folder: Path, state: PaintingState) -> None:
    """Replace the painting's checkpoint. Raises OSError; the previous one still exists then.

    Strokes in a person's hand are saved with the decoder of its shapes, so that the file suffices to go on.
    """
    memory = state.memory
    values = {
        "memory": {name: getattr(memory, name) for name in _NUMBERS},
        **{name: getattr(state, name) for name in _PLAIN},
    }
    strokes = state.remaining
    arrays: Arrays = {f"strokes_{name}": getattr(strokes, name) for name in strokes.row_arrays}
    if isinstance(strokes, FixedStrokes):  # lines of any length, one after the other
        arrays["strokes_lines"] = np.concatenate([np.zeros((0, 2)), *strokes.lines])
        arrays["points_of_lines"] = np.array([len(line) for line in strokes.lines], np.int64)
    if isinstance(strokes, ShapedStrokes):
        assert isinstance(strokes.shapes, StyleDecoder)  # the runner has no other shapes
        arrays["decoder"] = np.frombuffer(decoder_bytes(strokes.shapes), np.uint8)
        values["reach"] = strokes.reach
    arrays |= {f"memory_{name}": getattr(memory, name) for name in _ARRAYS}
    arrays |= {"palette_srgb": state.palette_srgb, "canvas": state.canvas, "goal": state.goal}
    write_checkpoint(folder / _PAINTING, _PAINTING_SCHEMA, values, arrays)


def copy_state(folder: Path, to: Path) -> None:
    """Copy the painting's checkpoint into another folder. Raises OSError."""
    atomic_write(to / _PAINTING, (folder / _PAINTING).read_bytes())


def has_state(folder: Path) -> bool:
    """Whether a painting was saved. One that ended before its first checkpoint has not painted: it is planned again."""
    return (folder / _PAINTING).is_file()


def load_state(folder: Path) -> PaintingState:
    """The painting's last checkpoint.

    Raises:
        ContractError: there is none, or it is damaged or of another version.
    """
    return read_checkpoint(folder / _PAINTING, _PAINTING_SCHEMA, "painting", _painting)


def _painting(values: dict[str, Any], arrays: Arrays) -> PaintingState:
    memory: dict[str, Any] = values["memory"] | {name: arrays[f"memory_{name}"] for name in _ARRAYS}
    memory |= {"canvas_size_m": tuple(memory["canvas_size_m"])}
    return PaintingState(
        remaining=_strokes(values, arrays),
        palette_srgb=arrays["palette_srgb"],
        memory=Memory(**memory),
        canvas=arrays["canvas"],
        goal=arrays["goal"],
        **{name: values[name] for name in _PLAIN},
    )


def _strokes(values: dict[str, Any], arrays: Arrays) -> PlannedPaths:
    if "points_of_lines" in arrays:
        pieces = np.split(arrays["strokes_lines"], np.cumsum(arrays["points_of_lines"]))[:-1]
        return FixedStrokes(as_rows(pieces), *(arrays[f"strokes_{name}"] for name in FixedStrokes.row_arrays[1:]))
    if "decoder" not in arrays:
        return Strokes(*(arrays[f"strokes_{name}"] for name in Strokes.row_arrays))
    rows = (arrays[f"strokes_{name}"] for name in ShapedStrokes.row_arrays)
    return ShapedStrokes(decoder_from(arrays["decoder"].tobytes(), _PAINTING), values["reach"], *rows)


def save_sculpture(folder: Path, state: SculptureState) -> None:
    """Replace the sculpture's checkpoint. Raises OSError; the previous one still exists then.

    Of the height maps, the first and the last are saved: the file's size does not grow with the number of actions.
    """
    progress = state.progress
    first_and_last = progress.heights_m[:: max(len(progress.heights_m) - 1, 1)]
    values = {
        "sessions": state.sessions,
        "stopped": state.stopped,
        "due": progress.due,
        "holes": progress.holes,
        "pending": progress.pending,
        "scanner_id": progress.scan.scanner_id,
        "t_s": progress.scan.t_s,
    }
    actions, volumes_m3 = as_columns(progress.actions)
    arrays: Arrays = {
        "goal_m": state.goal_m,
        "scan_m": progress.scan.height_m,
        "window_m": progress.scan.window_m,
        "table_plane": progress.scan.table_plane,
        "actions": actions,
        "volumes_m3": volumes_m3,
        "heights_m": np.stack(first_and_last),
        "objective": np.array(progress.values),
        "remaining": progress.remaining,
        "predicted_m": progress.predicted_m,
    }
    write_checkpoint(folder / _SCULPTURE, _SCULPTURE_SCHEMA, values, arrays)


def has_sculpture(folder: Path) -> bool:
    """Whether a sculpture was saved. One that ended before its first checkpoint has not touched the clay."""
    return (folder / _SCULPTURE).is_file()


def load_sculpture(folder: Path) -> SculptureState:
    """The sculpture's last checkpoint.

    Raises:
        ContractError: there is none, or it is damaged or of another version.
    """
    return read_checkpoint(folder / _SCULPTURE, _SCULPTURE_SCHEMA, "sculpture", _sculpture)


def _sculpture(values: dict[str, Any], arrays: Arrays) -> SculptureState:
    progress = SculptureProgress(
        scan=Scan(
            arrays["scan_m"], arrays["window_m"], arrays["table_plane"], values["scanner_id"], values["t_s"]
        ),
        actions=from_columns(arrays["actions"], arrays["volumes_m3"]),
        heights_m=tuple(arrays["heights_m"]),
        values=tuple(arrays["objective"].tolist()),
        expected_m=(),
        remaining=arrays["remaining"],
        predicted_m=arrays["predicted_m"],
        due=values["due"],
        holes=values["holes"],
        pending=values["pending"],
    )  # fmt: skip
    return SculptureState(arrays["goal_m"], progress, values["sessions"], values["stopped"])
