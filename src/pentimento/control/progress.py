"""Progress on a terminal: one line that is written over. Silent where nobody looks."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable
from typing import TextIO


class Progress:
    """A line such as ``stroke 34 of 100  ████······  error 0.0123  1 min 20 s``."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._clock, self._started_s = clock, clock()
        self._open = False

    def step(self, what: str, done: int, of: int, more: str = "") -> None:
        """``done`` of ``of``, drawn over the last such line."""
        if not self._stream.isatty():
            return
        full = round(20 * done / max(of, 1))
        spent_s = int(self._clock() - self._started_s)
        spent = f"{spent_s // 60} min {spent_s % 60} s" if spent_s >= 60 else f"{spent_s} s"
        line = f"{what} {done} of {of}  {'█' * full}{'·' * (20 - full)}  {more}{'  ' if more else ''}{spent}"
        width = shutil.get_terminal_size().columns - 1
        self._stream.write("\r" + line[:width].ljust(width))
        self._stream.flush()
        self._open = True

    def say(self, sentence: str) -> None:
        """A sentence that stays."""
        if not self._stream.isatty():
            return
        if self._open:
            self._stream.write("\n")
        self._stream.write(sentence + "\n")
        self._stream.flush()
        self._open = False
