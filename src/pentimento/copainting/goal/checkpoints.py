"""Checkpoints of a training: always one complete, the newest, in a folder of scratch."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import lightning

_PATTERN: Final = "step-*.ckpt"


class KeepCheckpoint(lightning.Callback):
    """Write everything that training needs to go on every so many steps; the old one goes when the new is complete."""

    def __init__(self, folder: Path, every: int) -> None:
        self.folder, self.every = folder, every

    def on_train_batch_end(self, trainer: lightning.Trainer, *_: Any) -> None:
        """Called by Lightning after each step, in every process; the first alone touches the folder."""
        if trainer.global_step % self.every:
            return
        if trainer.is_global_zero:
            self.folder.mkdir(parents=True, exist_ok=True)
        done = self.folder / f"step-{trainer.global_step:08d}.ckpt"
        unfinished = done.with_suffix(".part")
        trainer.save_checkpoint(unfinished)  # all processes meet here
        if not trainer.is_global_zero:
            return
        unfinished.replace(done)
        for old in self.folder.glob(_PATTERN):
            if old != done:
                old.unlink()


def latest_checkpoint(folder: Path) -> Path | None:
    """The newest complete checkpoint in a folder, if there is one."""
    return max(folder.glob(_PATTERN), default=None)
