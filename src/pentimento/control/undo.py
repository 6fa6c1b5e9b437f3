"""Undoing the robot's last batch of strokes, in the studio only: paint cannot be taken off a real sheet.

Before each batch the checkpoint is copied, with the length of the studio's journal. To undo is to go back to that copy:
the journal is cut to that length, so that the studio is restored to the sheet as it was, and what was recorded since is
deleted. The phase "undoing" on disk says that this is due, so that it is finished also after a kill; "undone", that it
is done and the person has not answered yet.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Final

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ConfigError
from pentimento.control.checkpoint import PaintingState, copy_state, has_state, load_state, save_state
from pentimento.control.open_robot import JOURNAL
from pentimento.control.recording import RECORD, remove_shards

UNDO: Final = "undo"
"""Folder of the checkpoints before the robot's batches since the person's last turn."""

_END: Final = "end"  # file of the journal's length and the number of the recording's next file


def remember(folder: Path, executed: int, shard: int) -> None:
    """Keep the checkpoint on disk as the one before a batch, which begins with a number of executed strokes.

    Args:
        shard: number of the recording's file that the batch is written to.
    """
    for number, kept in _kept(folder):
        if number >= executed:  # the robot went back further than to that batch
            shutil.rmtree(kept)
    place = folder / UNDO / f"{executed:05d}"
    atomic_write(place / _END, f"{(folder / JOURNAL).stat().st_size} {shard}".encode())
    copy_state(folder, place)


def forget(folder: Path) -> None:
    """The person's turn has changed the sheet or the plan: the batches before it can no longer be undone."""
    gone = folder / f".{UNDO}.old"
    shutil.rmtree(gone, ignore_errors=True)  # of a removal that was killed
    if (folder / UNDO).exists():
        (folder / UNDO).rename(gone)
        shutil.rmtree(gone)


def can_undo(folder: Path, state: PaintingState) -> bool:
    """Whether there is a batch to undo."""
    return any(number < state.executed for number, _ in _kept(folder))


def check_undo(folder: Path, state: PaintingState, *, in_studio: bool) -> None:
    """Raise ConfigError with a sentence for the person where nothing can be undone."""
    if not in_studio:
        raise ConfigError("Paint cannot be taken off a real sheet; only strokes in the studio can be undone.")
    if not can_undo(folder, state):
        raise ConfigError("The robot has painted nothing since you last drew or asked, so there is nothing to undo.")


def take_back(folder: Path) -> PaintingState:
    """Bring journal, recording and checkpoint back to before the last batch. No robot may be open on the journal."""
    now = load_state(folder)
    number, kept = max((number, kept) for number, kept in _kept(folder) if number < now.executed)
    journal_bytes, shard = (int(value) for value in (kept / _END).read_text(encoding="utf-8").split())
    with (folder / JOURNAL).open("r+b") as journal:
        journal.truncate(journal_bytes)
        os.fsync(journal.fileno())
    remove_shards(folder / RECORD, shard)
    strokes = now.executed - number
    message = f"The robot's last {'stroke is' if strokes == 1 else f'{strokes} strokes are'} undone."
    # A session's name is not used again.
    state = replace(load_state(kept), phase="undone", message=message, sessions=now.sessions, pending=False)
    save_state(folder, state)
    return state


def _kept(folder: Path) -> list[tuple[int, Path]]:
    """The checkpoints before batches, each with its number of executed strokes; without those half removed."""
    found = (place for place in (folder / UNDO).glob("*") if (place / _END).is_file() and has_state(place))
    return sorted((int(place.name), place) for place in found)
