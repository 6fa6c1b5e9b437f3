"""What a sculpture needs to go on after its computer went down: one file, replaced before and after every push."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pentimento.contracts.scan import Scan
from pentimento.control.checkpoint import Arrays, keep, kept
from pentimento.control.sculptor import Array, Progress, Stopped

_SCHEMA: Final = 1
_NAME: Final = "sculpture.npz"


@dataclass(frozen=True, eq=False)
class SculptureState:
    """A sculpture at a time."""

    goal_m: Array
    """[H, W]"""
    progress: Progress
    sessions: int
    """Each start and each resumption is one."""
    stopped: Stopped | None
    """Why it is done; None while it is not."""


def save_sculpture(folder: Path, state: SculptureState) -> None:
    """Replace the folder's state. Raises OSError, and the old state is still there then."""
    progress = state.progress
    told = {
        "sessions": state.sessions,
        "stopped": state.stopped,
        "due": progress.due,
        "holes": progress.holes,
        "pushing": progress.pushing,
        "scanner_id": progress.scan.scanner_id,
        "t_s": progress.scan.t_s,
    }
    arrays: Arrays = {
        "goal_m": state.goal_m,
        "scan_m": progress.scan.height_m,
        "window_m": progress.scan.window_m,
        "table_plane": progress.scan.table_plane,
        "actions": np.array(progress.actions, np.float64).reshape(-1, 5),
        "heights_m": np.stack(progress.heights_m),
        "values": np.array(progress.values),
        "expected_m": np.array(progress.expected_m, np.float32).reshape(-1, *state.goal_m.shape),
        "left": progress.left,
        "foreseen_m": progress.foreseen_m,
    }
    keep(folder / _NAME, _SCHEMA, told, arrays)


def has_sculpture(folder: Path) -> bool:
    """Whether one was saved. A sculpture that ended before had not touched the clay: it is planned anew."""
    return (folder / _NAME).is_file()


def load_sculpture(folder: Path) -> SculptureState:
    """The state that was saved last.

    Raises:
        ContractError: there is none, or it is damaged or of another version.
    """
    return kept(folder / _NAME, _SCHEMA, "sculpture", _sculpture)


def _sculpture(told: dict[str, Any], arrays: Arrays) -> SculptureState:
    scan = Scan(arrays["scan_m"], arrays["window_m"], arrays["table_plane"], told["scanner_id"], told["t_s"])
    progress = Progress(
        scan, tuple(arrays["actions"]), tuple(arrays["heights_m"]), tuple(arrays["values"].tolist()),
        tuple(arrays["expected_m"]), arrays["left"], arrays["foreseen_m"], told["due"], told["holes"],
        told["pushing"],
    )  # fmt: skip
    return SculptureState(arrays["goal_m"], progress, told["sessions"], told["stopped"])
