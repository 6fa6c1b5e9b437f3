"""A simulated plotter: a GRBL 1.1 controller on a pseudo-terminal, for dry runs and tests.

`python -m pentimento.robots.simulated_grbl --trace trace.svg` prints the port for a rig file and the places where the
pen marks the paper. When interrupted it writes the drawing. It shares no code with the driver.
"""

from __future__ import annotations

import argparse
import math
import os
import pty
import select
import termios
import threading
import time
import tty
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

_QUEUE = 15  # motions that GRBL looks ahead
_TICK_S = 0.002
_DECELERATION_S = 0.05
_LOOK_S = 0.1


@dataclass
class _Motion:
    target: tuple[float, float, float]
    seconds: float
    begun_at: float = 0.0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass
class Faults:
    """Faults to inject, by the number of the received line (from 0)."""

    answers: dict[int, str] = field(default_factory=dict)
    """Answers in place of "ok"; these lines are not executed."""
    lost: frozenset[int] = frozenset()
    """Lines that never arrive: no answer."""
    swallowed: frozenset[int] = frozenset()
    """Lines that are answered and not executed."""
    garbled: dict[int, Callable[[str], str]] = field(default_factory=dict)
    """Lines that arrive as another text."""
    silent_from: int | None = None
    """From this line on nothing is answered, not even bytes: the cable is unplugged."""
    delay_s: float = 0.0
    """Before every answer."""


class SimulatedGrbl:
    """Simulates a pen: `trace` has each place where it stopped or turned, in millimetres, with the pen's S.

    Time runs `hurry` times as fast as real time. `offset_mm` is the work coordinates' origin in the machine's. The
    settings 110 to 112 limit the rates of the axes, and 22=1 asks for a homing after each start.

    With `boots_s` the board starts again, for so long, whenever its port is opened, unless it was closed with HUPCL
    cleared: it takes the place where it stands for its zero, as an Arduino does.
    """

    def __init__(
        self,
        faults: Faults | None = None,
        hurry: float = 1.0,
        offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
        settings: dict[str, str] | None = None,
        version: str = "1.1h",
        boots_s: float | None = None,
    ) -> None:
        self.faults = faults or Faults()
        self.lines: list[str] = []
        self.trace: list[tuple[float, float, float, int]] = []
        self._hurry, self._offset = hurry, offset_mm
        self._settings = {"10": "1", "13": "0", "20": "0", "32": "0"} | (settings or {})
        self._version = version
        self._place = (0.0, 0.0, 0.0)
        self._pen = 0
        self._state = "Idle"
        self._holding_since: float | None = None
        self._queue: deque[_Motion] = deque()
        self._waiting: deque[str] = deque()
        self._dwell_until = 0.0
        self._cut = self._hung_up = False
        self._reports = 0
        self._text = b""
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.port = os.ttyname(slave)
        self._boots_s, self._is_open, self._starts_at = boots_s, False, 0.0
        self.starts = 0
        self._slave: int | None = slave  # held open, so that the port outlives its users
        self._greet()
        if boots_s is not None:
            line = termios.tcgetattr(slave)
            line[2] |= termios.HUPCL  # as a serial port has it, and a pseudo-terminal has not
            termios.tcsetattr(slave, termios.TCSANOW, line)
            os.close(slave)  # so that the controller sees when the port is opened
            self._slave = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulated-grbl", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop, and take the port away."""
        self._ended.set()
        self._thread.join(5)
        if not self._hung_up:
            self.hang_up()

    def hang_up(self) -> None:
        """Take the port away at once, as when the plug is pulled."""
        self._ended.set()
        self._thread.join(5)
        self._hung_up = True
        os.close(self._master)
        if self._slave is not None:
            os.close(self._slave)

    @property
    def place_mm(self) -> tuple[float, float, float]:
        """Where the pen is, in work coordinates."""
        return self._work(self._place)

    @property
    def moving(self) -> bool:
        """Whether a motion is in progress."""
        return bool(self._queue) and self._state == "Run"

    def _run(self) -> None:
        while not self._ended.is_set():
            if self._boots_s is not None and not self._is_awake(self._boots_s):
                time.sleep(_TICK_S)
                continue
            ready, _, _ = select.select([self._master], [], [], _TICK_S)
            if ready:
                self._take(self._read())
            self._advance()
            self._answer_waiting()

    def _read(self) -> bytes:
        try:
            return os.read(self._master, 4096)
        except OSError:  # nobody has the port open
            return b""

    def _is_awake(self, boots_s: float) -> bool:
        """Whether somebody has the port open and the board has started since; what it is sent before is lost."""
        look = select.poll()
        look.register(self._master, select.POLLHUP)
        is_open = not any(event & select.POLLHUP for _, event in look.poll(0))
        resets = bool(termios.tcgetattr(self._master)[2] & termios.HUPCL)
        if is_open and not self._is_open and resets:
            self._starts_at = time.monotonic() + boots_s
            self._queue.clear()
            self._waiting.clear()
        self._is_open = is_open
        if not self._starts_at:
            return is_open
        if time.monotonic() < self._starts_at:
            if is_open and select.select([self._master], [], [], 0)[0]:
                self._read()
            return False
        self._starts_at, self._place, self._pen, self._text = 0.0, (0.0, 0.0, 0.0), 0, b""
        self._state = "Alarm" if self._settings.get("22") == "1" else "Idle"
        self.starts += 1
        self._note(self._place)
        if is_open:
            self._greet()
        return is_open

    def _take(self, data: bytes) -> None:
        for byte in data:
            match bytes([byte]):
                case _ if self._cut:
                    return
                case b"?":
                    self._report()
                case b"!":
                    if self._state in ("Idle", "Run"):
                        self._state, self._holding_since = "Hold", time.monotonic()
                case b"~":
                    if self._state == "Hold":
                        self._state = "Run" if self._queue else "Idle"
                case b"\x18":
                    self._reset()
                case b"\n":
                    self._receive_line(self._text.decode("ascii"))
                    self._text = b""
                case other:
                    self._text += other

    def _receive_line(self, line: str) -> None:
        number = len(self.lines)
        self.lines.append(line)
        if self.faults.silent_from is not None and number >= self.faults.silent_from:
            self._cut = True
        elif number in self.faults.answers:
            self._say(self.faults.answers[number])
            if self.faults.answers[number].startswith("ALARM"):
                self._queue.clear()
                self._state = "Alarm"
        elif number in self.faults.swallowed:
            self._say("ok")
        elif number not in self.faults.lost:
            self._waiting.append(self.faults.garbled.get(number, str)(line))

    def _answer_waiting(self) -> None:
        """Execute and answer waiting lines while the queue has room."""
        while self._waiting and not self._cut:
            line = self._waiting[0]
            if line.startswith("G4"):
                if self._queue or self._state == "Hold":
                    return
                if self._dwell_until == 0.0:
                    self._dwell_until = time.monotonic() + float(line.split("P")[1]) / self._hurry
                if time.monotonic() < self._dwell_until:
                    return
                self._dwell_until = 0.0
            elif line.startswith(("G0", "G1 ", "M3", "M5")) and (
                len(self._queue) >= _QUEUE or (line[0] == "M" and self._queue)
            ):
                return
            self._waiting.popleft()
            if self.faults.delay_s:
                time.sleep(self.faults.delay_s)
            self._say(self._execute(line))

    def _execute(self, line: str) -> str:
        if line == "$X":
            self._state = "Idle" if self._state == "Alarm" else self._state
            return "ok"
        if line == "$H":
            if self._settings.get("22") != "1":
                return "error:5"
            self._place, self._state = (0.0, 0.0, 0.0), "Idle"
            return "ok"
        if line == "$$":
            for key, value in self._settings.items():
                self._say(f"${key}={value}")
            return "ok"
        if self._state == "Alarm":
            return "error:9"
        words = line.split()
        if words[0] in ("G21", "G90", "G94", "G4"):
            return "ok"
        if words[0] in ("M3", "M5"):
            self._pen = int(words[1][1:]) if words[0] == "M3" else 0
            self._note(self._place)
            return "ok"
        if words[0] not in ("G0", "G1"):
            return "error:20"
        try:
            values = {word[0]: float(word[1:]) for word in words[1:]}
        except ValueError:
            return "error:2"
        if not values.keys() <= set("XYZF") or (words[0] == "G1" and values.get("F", 0) <= 0):
            return "error:22"
        begin = self._queue[-1].target if self._queue else self._place
        machine = [values.get(axis, self._work(begin)[i]) + self._offset[i] for i, axis in enumerate("XYZ")]
        target = (machine[0], machine[1], machine[2])
        minutes = max(
            math.dist(begin, target) / values.get("F", 5000.0),
            *(abs(target[i] - begin[i]) / float(self._settings.get(f"11{i}", "inf")) for i in range(3)),
        )
        self._queue.append(_Motion(target, 60 * minutes / self._hurry))
        return "ok"

    def _advance(self) -> None:
        """Advance the pen along the motions of the queue to the present time."""
        now = time.monotonic()
        if self._state == "Hold" or self._state == "Alarm":
            return
        while self._queue:
            motion = self._queue[0]
            if motion.begun_at == 0.0:
                motion.begun_at, motion.start, self._state = now, self._place, "Run"
                self._note(self._place)
            share = 1.0 if motion.seconds == 0 else min((now - motion.begun_at) / motion.seconds, 1.0)
            x, y, z = (a + share * (b - a) for a, b in zip(motion.start, motion.target, strict=True))
            self._place = (x, y, z)
            if share < 1:
                return
            now = motion.begun_at + motion.seconds
            self._queue.popleft()
            self._note(self._place)
            if self._queue:
                self._queue[0].begun_at, self._queue[0].start = now, self._place
        if self._state == "Run":
            self._state = "Idle"

    def _reset(self) -> None:
        """GRBL loses its place when it is reset in the middle of a motion."""
        lost = self._state == "Run" or (self._state == "Hold" and not self._at_rest())
        self._queue.clear()
        self._waiting.clear()
        self._text, self._dwell_until, self._pen = b"", 0.0, 0
        self._note(self._place)
        self._state = "Alarm" if lost or self._state == "Alarm" else "Idle"
        if lost:
            self._say("ALARM:3")
        self._greet()

    def _at_rest(self) -> bool:
        return self._holding_since is None or time.monotonic() - self._holding_since > _DECELERATION_S

    def _report(self) -> None:
        if self._cut:
            return
        phase = "" if self._state != "Hold" else ":0" if self._at_rest() else ":1"
        place = ",".join(f"{value:.3f}" for value in self._place)
        offset = ""
        if self._reports % 10 == 1:
            offset = "|WCO:" + ",".join(f"{value:.3f}" for value in self._offset)
        self._reports += 1
        self._say(f"<{self._state}{phase}|MPos:{place}|FS:0,0{offset}>")

    def _work(self, place: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (a - b for a, b in zip(place, self._offset, strict=True))
        return x, y, z

    def _note(self, place: tuple[float, float, float]) -> None:
        self.trace.append((*self._work(place), self._pen))

    def _greet(self) -> None:
        self._say(f"\r\nGrbl {self._version} ['$' for help]")

    def _say(self, text: str) -> None:
        os.write(self._master, text.encode("ascii") + b"\r\n")


def svg_of(trace: list[tuple[float, float, float, int]], paper_z_mm: float) -> str:
    """The trace at or below the paper's height, as an SVG in millimetres (y up in the trace)."""
    pieces: list[str] = []
    for (x0, y0, z0, _), (x1, y1, z1, _) in pairwise(trace):
        if max(z0, z1) <= paper_z_mm and (x0, y0) != (x1, y1):
            pieces.append(f"M{x0:.3f},{-y0:.3f} L{x1:.3f},{-y1:.3f}")
    xs, ys = [t[0] for t in trace] or [0.0], [-t[1] for t in trace] or [0.0]
    box = f"{min(xs) - 5:.1f} {min(ys) - 5:.1f} {max(xs) - min(xs) + 10:.1f} {max(ys) - min(ys) + 10:.1f}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}">'
        f'<path d="{" ".join(pieces)}" fill="none" stroke="black" stroke-width="0.5"/></svg>\n'
    )


def main() -> None:
    """Serve one simulated plotter until Ctrl-C."""
    parser = argparse.ArgumentParser(description="A GRBL plotter on a pseudo-terminal.")
    parser.add_argument("--trace", type=Path, help="SVG of what a pen on a z axis drew, written at Ctrl-C")
    parser.add_argument("--paper-z-mm", type=float, default=-10.0, help="height of the paper")
    parser.add_argument("--hurry", type=float, default=1.0, help="how many times as fast as a real one it moves")
    arguments = parser.parse_args()
    plotter = SimulatedGrbl(hurry=arguments.hurry)
    print(f"A plotter answers on {plotter.port}; Ctrl-C ends it.", flush=True)
    seen, drawing = 0, False
    try:
        while True:
            time.sleep(_LOOK_S)
            for x, y, z, _ in plotter.trace[seen:]:
                if z <= arguments.paper_z_mm and not drawing:
                    print(f"The pen marks the paper from x = {x:.1f} mm, y = {y:.1f} mm of the machine.", flush=True)
                drawing = z <= arguments.paper_z_mm
                seen += 1
    except KeyboardInterrupt:
        if arguments.trace is not None:
            arguments.trace.write_text(svg_of(plotter.trace, arguments.paper_z_mm), encoding="utf-8")
            print(f"What it drew is {arguments.trace}.")
    finally:
        plotter.close()


if __name__ == "__main__":
    main()
