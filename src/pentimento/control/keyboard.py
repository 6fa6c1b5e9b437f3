"""A person at the terminal: words to the robot, answers to its requests, and signals that stop it at once."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final, TextIO

from pentimento.control.commands import Control, Word
from pentimento.control.progress import Progress

_KEYS: Final[dict[str, Word]] = {"p": "pause", "t": "your turn", "": "go on", "s": "stop"}


class Keyboard:
    """Lines at a terminal. While a request waits for its answer, the next line is that; all others are words."""

    def __init__(self, control: Control, progress: Progress, lines: TextIO) -> None:
        """Begin to listen to ``lines``, where they are a terminal's."""
        self._control, self._progress, self._lines = control, progress, lines
        self._asked = threading.Lock()
        self._answered: threading.Event | None = None
        if lines.isatty():
            progress.say("p and Enter: pause; t: your turn; Enter: go on; s: stop after this stroke; Ctrl-C: at once.")
            threading.Thread(target=self._hear, name="keyboard", daemon=True).start()

    def ask(self, request: str) -> None:
        """Put a request to the person, and return when it is confirmed.

        Raises EOFError where nobody can: there is no terminal.
        """
        if not self._lines.isatty():
            raise EOFError(f"Nobody is at a terminal to confirm: {request}")
        with self._asked:
            self._answered = threading.Event()
            self._progress.say(f"{request} [Enter]")
            self._answered.wait()
            self._answered = None

    def _hear(self) -> None:
        for line in self._lines:
            waiting, word = self._answered, _KEYS.get(line.strip().lower())
            if waiting is not None:
                waiting.set()
            elif word is not None:
                self._control.say(word)


@contextmanager
def ended_by_signal() -> Iterator[None]:
    """While the block runs, SIGTERM ends it as Ctrl-C does: the tool is lifted, the state kept."""

    def end(_signal: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def at_terminal(control: Control, progress: Progress) -> Keyboard:
    """The keyboard of this process."""
    return Keyboard(control, progress, sys.stdin)
