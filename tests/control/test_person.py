"""Commands, requests, signals and progress at a terminal."""

from __future__ import annotations

import io
import os
import signal
import threading
import time
from collections.abc import Callable

import pytest

from pentimento.control.person import Control, Keyboard, Order, Progress, ended_by_signal


class Terminal(io.StringIO):
    """A stream that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


class Lines(Terminal):
    """A keyboard at which a test types."""

    def __init__(self) -> None:
        super().__init__()
        self._read, self._write = os.pipe()
        self._file = os.fdopen(self._read)
        self._ended = threading.Event()

    def __iter__(self) -> Lines:
        return self

    def __next__(self) -> str:
        line = self._file.readline()
        if not line:
            self._file.close()
            self._ended.set()
            raise StopIteration
        return line

    def type(self, text: str) -> None:
        os.write(self._write, text.encode())

    def end(self) -> None:
        os.close(self._write)
        assert self._ended.wait(5)


def _waits_for(met: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 5
    while not met():
        assert time.monotonic() < deadline_s
        time.sleep(0.005)


def test_control_keeps_the_last_command_and_never_replaces_stop() -> None:
    control = Control()
    assert control.poll() is None
    control.send("pause")
    control.send("your turn")
    assert control.poll() == Order("your turn") and control.poll() is None
    control.send("stop")
    control.send("go on")
    assert control.poll() == Order("stop")


def test_control_wait_returns_a_command_from_another_thread() -> None:
    control = Control()
    threading.Timer(0.05, control.send, ("go on",)).start()
    assert control.wait() == Order("go on")


def test_keyboard_maps_keys_to_commands_and_enter_to_an_answer() -> None:
    control, shown, lines = Control(), Terminal(), Lines()
    keyboard = Keyboard(control, Progress(shown), lines)
    lines.type("T\n")
    assert control.wait() == Order("your turn")
    lines.type(" a tree beside it\n")
    assert control.wait() == Order("wish", "a tree beside it")
    lines.type("2\n")
    assert control.wait() == Order("choose", "2")
    confirmed = threading.Thread(target=keyboard.ask, args=("Fill the paints",))
    confirmed.start()
    _waits_for(lambda: "Fill the paints [Enter]" in shown.getvalue())
    lines.type("\n")
    confirmed.join(5)
    assert not confirmed.is_alive() and control.poll() is None  # the Enter was the answer, not a command
    lines.type("\n")
    assert control.wait() == Order("go on")
    lines.end()


def test_keyboard_without_terminal_raises_eof_error() -> None:
    keyboard = Keyboard(Control(), Progress(io.StringIO()), io.StringIO("\n"))
    with pytest.raises(EOFError, match="Nobody"):
        keyboard.ask("Fill the paints")


def test_sigterm_raises_keyboard_interrupt() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), ended_by_signal():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1)
    assert signal.getsignal(signal.SIGTERM) is before


def test_progress_writes_one_line_on_a_terminal_and_nothing_otherwise() -> None:
    now = [0.0]
    shown = Terminal()
    progress = Progress(shown, lambda: now[0])
    progress.step("stroke", 5, 20, "painting")
    now[0] = 75.0
    progress.step("stroke", 10, 20, "painting")
    last = shown.getvalue().rsplit("\r", 1)[1]
    assert "stroke 10 of 20" in last and last.count("█") == last.count("·") == 10 and "1 min 15 s" in last
    progress.message("Done.")
    assert shown.getvalue().endswith("\nDone.\n")
    silent = io.StringIO()
    quiet = Progress(silent)
    quiet.step("stroke", 1, 2)
    quiet.message("Done.")
    assert silent.getvalue() == ""
