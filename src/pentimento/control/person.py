"""The person beside the robot: commands, answers to the robot's requests, progress on the terminal, and signals."""

from __future__ import annotations

import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Final, Literal, TextIO

from pentimento.control.expression import PLAIN, Expression

Command = Literal["pause", "your turn", "go on", "stop", "undo", "wish", "choose", "draw"]

COMMANDS: Final[tuple[Command, ...]] = ("pause", "your turn", "go on", "undo", "stop")
"""Those without a value."""

_KEYS: Final[dict[str, Command]] = {
    "p": "pause", "t": "your turn", "": "go on", "u": "undo", "s": "stop",
    "pause": "pause", "your turn": "your turn", "go on": "go on", "undo": "undo", "stop": "stop",
}  # fmt: skip
_BAR: Final = 20
"""Characters of the progress bar."""


@dataclass(frozen=True)
class Order:
    """A command of the person."""

    command: Command
    value: str = ""
    """The words of a wish, the number of a goal to choose (from 1), a line that was drawn, see `drawn`, or what a
    person is told first at "your turn"."""
    expression: Expression = PLAIN
    """How a wish is painted."""


class Control:
    """Orders that were sent and not yet received: the last one, and before it all lines that were drawn.

    Any thread may send; the loop receives between actions.
    """

    def __init__(self) -> None:
        self.hand: str | None = None
        """Whose hand the next plan is in; None for the robot's own strokes."""
        self._changed = threading.Condition()
        self._orders: list[Order] = []

    def send(self, command: Command, value: str = "", expression: Expression = PLAIN) -> None:
        """Add a line that was drawn, or replace the order that waits. Nothing replaces ``stop``."""
        with self._changed:
            if not any(order.command == "stop" for order in self._orders):
                if command != "draw":
                    self._orders = [order for order in self._orders if order.command == "draw"]
                self._orders.append(Order(command, value, expression))
            self._changed.notify_all()

    def poll(self) -> Order | None:
        """The next order, if any."""
        with self._changed:
            return self._orders.pop(0) if self._orders else None

    def is_waiting(self) -> bool:
        """Whether an order waits that is no line."""
        with self._changed:
            return any(order.command != "draw" for order in self._orders)

    def forget(self, command: Command) -> None:
        """Drop such orders that wait: they were given before what they would answer now."""
        with self._changed:
            self._orders = [order for order in self._orders if order.command != command]

    def wait(self) -> Order:
        """The next order, whenever it comes."""
        with self._changed:
            self._changed.wait_for(lambda: self._orders)
            return self._orders.pop(0)


class Progress:
    """A line such as ``stroke 34 of 100  ████······  error 0.0123  1 min 20 s``. Silent where there is no terminal."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._clock, self._started_s = clock, clock()
        self._open = False

    def step(self, what: str, done: int, of: int, more: str = "") -> None:
        """``done`` of ``of``, written over the last such line."""
        if not self._stream.isatty():
            return
        full = round(_BAR * done / max(of, 1))
        spent_s = int(self._clock() - self._started_s)
        spent = f"{spent_s // 60} min {spent_s % 60} s" if spent_s >= 60 else f"{spent_s} s"
        line = f"{what} {done} of {of}  {'█' * full}{'·' * (_BAR - full)}  {more}{'  ' if more else ''}{spent}"
        width = shutil.get_terminal_size().columns - 1
        self._stream.write("\r" + line[:width].ljust(width))
        self._stream.flush()
        self._open = True

    def message(self, text: str) -> None:
        """A line that stays."""
        if not self._stream.isatty():
            return
        if self._open:
            self._stream.write("\n")
        self._stream.write(text + "\n")
        self._stream.flush()
        self._open = False


class Keyboard:
    """Lines at a terminal. While a request waits for its answer, the next line answers it; other lines are commands."""

    def __init__(self, control: Control, progress: Progress, lines: TextIO) -> None:
        """Begin to read ``lines``, if they come from a terminal."""
        self._control, self._progress, self._lines = control, progress, lines
        self._prompt_lock = threading.Lock()
        self._answered: threading.Event | None = None
        if lines.isatty():
            progress.message(
                "p and Enter: pause; t: your turn; Enter: go on; u: undo the robot's last strokes; s: stop after this "
                "stroke; Ctrl-C: at once. "
                "Other words ask for something new; a number chooses a goal."
            )
            threading.Thread(target=self._read, name="keyboard", daemon=True).start()

    def ask(self, request: str) -> None:
        """Show a request to the person, and return when it is confirmed. Raises EOFError without a terminal."""
        if not self._lines.isatty():
            raise EOFError(f"Nobody is at a terminal to confirm: {request}")
        with self._prompt_lock:
            self._answered = threading.Event()
            self._progress.message(f"{request} [Enter]")
            self._answered.wait()
            self._answered = None

    def _read(self) -> None:
        for line in self._lines:
            waiting, words = self._answered, line.strip()
            if waiting is not None:
                waiting.set()
            elif (command := _KEYS.get(words.lower())) is not None:
                self._control.send(command)
            else:
                self._control.send("choose" if words.isdecimal() else "wish", words)


def at_terminal(control: Control, progress: Progress) -> Keyboard:
    """The keyboard of this process."""
    return Keyboard(control, progress, sys.stdin)


@contextmanager
def ended_by_signal() -> Iterator[None]:
    """While the block runs, SIGTERM ends it as Ctrl-C does: the tool is lifted and the state saved."""

    def end(_signal: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
