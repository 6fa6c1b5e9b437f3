"""What a painting needs to go on after its computer went down: one file, replaced whole after every stroke."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.covariates import Memory
from pentimento.control.checkpoint import Arrays, keep, kept
from pentimento.planning.strokes.bezier import Strokes

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]

Phase = Literal["painting", "paused", "your turn", "stopped", "done"]

_SCHEMA: Final = 2
_NAME: Final = "state.npz"
_STROKES: Final = ("middle_m", "theta_rad", "length_m", "bend_m", "press_m", "color")
_NUMBERS: Final = ("since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "mark_width_m", "canvas_size_m")
_PLAIN: Final = (
    "begun", "made", "sessions", "shard", "turns", "clock_s", "robot_clock_s", "unix_s", "phase", "sentence",
)  # fmt: skip
_ARRAYS: Final = ("last_color_srgb", "painted_at_s", "ink", "color", "carried")


@dataclass(frozen=True, eq=False)
class State:
    """A painting between two strokes, or with one on its way."""

    left: Strokes
    """Still to be made, in their order."""
    begun: bool
    """The first of them was sent to the robot, which has not said that it is made."""
    palette_srgb: FloatArray
    """[K, 3] paints that are laid out, or the tool's own ink."""
    memory: Memory
    """Of tool and canvas, before the first of ``left``."""
    canvas: Picture
    """[H, W, 3] sRGB, as it was seen last."""
    made: int
    """Strokes made so far."""
    sessions: int
    """Recordings so far: each start and each resumption is one."""
    shard: int
    """Of the recording: number of the next file."""
    turns: int
    """That a person has had."""
    clock_s: float
    """Since the painting's start."""
    robot_clock_s: float
    """The robot's own, then."""
    unix_s: float
    """The computer's, then."""
    phase: Phase
    sentence: str
    """What happens, or what happened and what to do."""


def save_state(folder: Path, state: State) -> None:
    """Replace the folder's state. Raises OSError, and the old state is still there then."""
    memory = state.memory
    told = {
        "memory": {name: getattr(memory, name) for name in _NUMBERS},
        **{name: getattr(state, name) for name in _PLAIN},
    }
    arrays: Arrays = {f"left_{name}": array for name, array in zip(_STROKES, state.left.arrays(), strict=True)}
    arrays |= {f"memory_{name}": getattr(memory, name) for name in _ARRAYS}
    arrays |= {"palette_srgb": state.palette_srgb, "canvas": state.canvas}
    keep(folder / _NAME, _SCHEMA, told, arrays)


def has_state(folder: Path) -> bool:
    """Whether one was saved. A painting that ended before had not begun to paint: it is planned anew."""
    return (folder / _NAME).is_file()


def load_state(folder: Path) -> State:
    """The state that was saved last.

    Raises:
        ContractError: there is none, or it is damaged or of another version.
    """
    return kept(folder / _NAME, _SCHEMA, "painting", _painting)


def _painting(told: dict[str, Any], arrays: Arrays) -> State:
    memory: dict[str, Any] = told["memory"] | {name: arrays[f"memory_{name}"] for name in _ARRAYS}
    memory |= {"canvas_size_m": tuple(memory["canvas_size_m"])}
    return State(
        left=Strokes(*(arrays[f"left_{name}"] for name in _STROKES)),
        palette_srgb=arrays["palette_srgb"],
        memory=Memory(**memory),
        canvas=arrays["canvas"],
        **{name: told[name] for name in _PLAIN},
    )
