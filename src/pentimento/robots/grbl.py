"""A pen plotter with a GRBL 1.1 controller on a serial port.

One line is sent at a time and its "ok" awaited. The controller buffers motions itself, and after an error no later
motion is executed. GRBL has no checksums; each motion therefore ends with a query of the machine's position.
(Protocol: the GRBL project's wiki, "Grbl v1.1 Interface".)
"""

from __future__ import annotations

import re
import threading
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.codec import check_keys
from pentimento.robots.gcode import PREAMBLE, gcode_of, pen_of, servo_lines
from pentimento.robots.machine import HaltedError, MachineError, positions_only
from pentimento.robots.rig import Rig
from pentimento.robots.serial_line import SerialLine

FloatArray = NDArray[np.float64]

HOLD, RESET, ASK = b"!", b"\x18", b"?"
"""Bytes that GRBL executes at once, past its queue."""
ANSWER_S = 2.0
"""A line counts as lost if it is not answered for so long after the motions before it."""
REST_S = 1.0
"""Max time of the deceleration after a feed hold, beyond that of the controller's own acceleration."""
HOME_S = 120.0
"""Max time of a homing cycle."""
_POLL_S = 0.02
_PLACE_M = 5e-5  # GRBL's steps are finer, and lost ones coarser
_QUIET_S = 0.1  # without a line, after which the greeting is complete
_WAKE_S = 4.0  # an Arduino starts its boot loader when its port is opened
_HOMING = "22"  # the setting of homing switches
_RATES, _ACCELERATIONS = ("110", "111", "112"), ("120", "121", "122")  # of x, y, z: mm/min, mm/s²
_STATUS = re.compile(r"<(?P<state>\w+)(?::(?P<phase>\d+))?\|(?P<kind>[MW])Pos:(?P<place>[-\d.,]+)(?:\|.*)?>")
_OFFSET = re.compile(r"\|WCO:([-\d.,]+)")
_NEEDED = {"13": ("0", "it must report millimetres"), "32": ("0", "laser mode changes what M3 does")}
_ERRORS = {"9": "it is locked after an alarm", "15": "a place beyond its travel", "22": "a feed is missing"}


class _Status(NamedTuple):
    """A report of the controller."""

    state: str
    phase: str | None
    """Of the state, such as 0 for a hold that has come to rest."""
    place_m: FloatArray
    """[3], work coordinates."""


class GrblPlotter:
    """A Machine (see machine.py). Its frame is the controller's work coordinates, in metres here."""

    def __init__(self, line: SerialLine, rig: Rig) -> None:
        """Wake the controller and check that it is ready and reads millimetres. Raises MachineError if not."""
        self._line, self._pen = line, pen_of(rig.machine, rig)
        self._up_z_m = self._pen.paper_z_m + rig.travel_height_m
        self._servo_z_m = self._up_z_m
        self._halted = threading.Event()
        self._talking = threading.Lock()
        self._offset_m: FloatArray | None = None
        self._doubt: str | None = None
        self._to_home = False
        with self._talking:
            woken = self._was_woken()
            if not woken:
                self._require_idle(self._status().state)
                line.send_byte(RESET)  # clears modes and half a line of another program
                self._await_greeting(ANSWER_S)
            while line.receive(_QUIET_S) is not None:
                pass
            settings = self._checked_settings(self._command("$$", ANSWER_S))
            axes = 3 if self._pen.kind == "z" else 2
            self._rates_m_s = _values(settings, _RATES[:axes]) / 60_000
            self._accelerations_m_s2 = _values(settings, _ACCELERATIONS[:axes]) / 1000
            status = self._status()
            self._to_home = woken and status.state == "Alarm" and settings.get(_HOMING, "0").split()[:1] == ["1"]
            if not self._to_home:
                self._require_idle(status.state)
                self._prepare()
            if woken:
                self._doubt = self._request(status.place_m)
            else:
                line.keep_board_awake()

    def doubt(self) -> str | None:
        """A board that was reset when its port was opened takes the place where the pen stands for its zero."""
        return self._doubt

    def settle(self) -> None:
        """The pen was put to its place, or may be homed. From then on, opening the port does not reset the board."""
        with self._talking:
            if self._to_home:
                self._command("$H", HOME_S)
                self._require_idle(self._status().state)
                self._prepare()
            self._line.keep_board_awake()
            self._doubt, self._to_home = None, False

    def _request(self, place_m: FloatArray) -> str:
        if self._to_home:
            return (
                f"The plotter on {self._line.port} was reset when its port was opened, and it waits for its homing. "
                "Clear its way: when you confirm, it moves to its switches."
            )
        place_mm = np.round(1000 * place_m[: 3 if self._pen.kind == "z" else 2], 3) + 0.0
        return (
            f"The plotter on {self._line.port} was reset when its port was opened, and it does not know where its pen "
            f"is. Put the pen's tip by hand to {place_mm.tolist()} mm in the rig's coordinates, where it takes it to "
            "be, then confirm."
        )

    def _require_idle(self, state: str) -> None:
        if state != "Idle":
            raise MachineError(
                f"The plotter on {self._line.port} is in state {state} and not Idle; home or unlock it by hand, and "
                "set its work zero again."
            )

    def where(self) -> FloatArray:
        """The tip's place; the height of a servo's pen is that of the last command."""
        with self._talking:
            place_m = self._status().place_m
        if self._pen.kind == "servo":
            place_m[2] = self._servo_z_m
        return positions_only(place_m)

    def follow(self, times_s: FloatArray, poses: FloatArray) -> FloatArray:
        places_m = poses[:, :3, 3]
        if self._doubt is not None:
            raise MachineError(f"Nothing moved. {self._doubt}")
        lasting_s = self._lasting_s(times_s, places_m)
        # An "ok" may have to wait until the motions before it have made room in the queue.
        longest_s = float(lasting_s.max())
        with self._talking:
            for line in gcode_of(times_s, places_m, self._pen):
                self._command(line, ANSWER_S + longest_s)
            # A dwell is answered when all motions before it are done; they may take longer than asked for.
            self._command("G4 P0.01", ANSWER_S + 2 * float(lasting_s.sum()))
            self._servo_z_m = float(places_m[-1, 2])
            self._check_arrival(places_m[-1])
        return np.full(poses.shape, np.nan)

    def halt(self) -> None:
        """Feed hold, so that no step is lost; then a soft reset, which empties the queue; a servo's pen goes up."""
        if self._doubt is not None:
            return  # nothing was moved
        self._halted.set()
        self._line.send_byte(HOLD)
        if not self._talking.acquire(timeout=REST_S):
            raise MachineError(f"The exchange with the plotter on {self._line.port} did not end when it was halted.")
        try:
            self._halted.clear()
            self._await_rest()
            self._line.send_byte(RESET)
            self._await_greeting(ANSWER_S)
            self._command("$X", ANSWER_S)  # unlocks the plotter where it is in alarm, so that the pen can be raised
            self._prepare()
        finally:
            self._talking.release()

    def close(self) -> None:
        """Leave the pen up: M5 would take a servo to 0."""
        try:
            if self._pen.kind == "servo" and not self._to_home:
                with self._talking:
                    for command in servo_lines(self._pen, down=False):
                        self._command(command, ANSWER_S)
        finally:
            self._line.close()

    def _lasting_s(self, times_s: FloatArray, places_m: FloatArray) -> FloatArray:
        """Max times [N - 1] of the segments: as commanded, or at the axes' own rates from rest to rest."""
        ways_m = np.abs(np.diff(places_m[:, : len(self._rates_m_s)], axis=0))
        own_s = ways_m / self._rates_m_s + 2 * np.sqrt(ways_m / self._accelerations_m_s2)
        return np.asarray(np.maximum(np.diff(times_s), own_s.max(axis=1)))

    def _prepare(self) -> None:
        """Set what a reset clears: the modes, and a servo's pen."""
        for command in PREAMBLE:
            self._command(command, ANSWER_S)
        if self._pen.kind == "servo":
            for command in servo_lines(self._pen, down=False):
                self._command(command, ANSWER_S)
            self._servo_z_m = self._up_z_m

    def _command(self, command: str, within_s: float) -> list[str]:
        """Send a line and wait for its "ok"; returns what came before it."""
        if self._halted.is_set():
            raise HaltedError(f"The plotter on {self._line.port} was halted.")
        self._line.send(command)
        answers: list[str] = []
        deadline_s = time.monotonic() + within_s
        while time.monotonic() < deadline_s:
            answer = self._line.receive(_POLL_S)
            if self._halted.is_set():
                raise HaltedError(f"The plotter on {self._line.port} was halted.")
            if answer is None:
                continue
            if answer == "ok":
                return answers
            if answer.startswith(("error:", "ALARM:", "Grbl ")):
                meaning = _ERRORS.get(answer.removeprefix("error:"), "see GRBL's list of error and alarm codes")
                raise MachineError(
                    f"The plotter on {self._line.port} answered {answer!r} to {command!r} ({meaning}); the rest of "
                    "the motion was not sent."
                )
            answers.append(answer)
        raise MachineError(
            f"The plotter on {self._line.port} did not answer {command!r} within {within_s:.1f} s; the line or its "
            "answer is lost, and the rest of the motion was not sent. Check the cable."
        )

    def _status(self) -> _Status:
        deadline_s = time.monotonic() + ANSWER_S
        self._line.send_byte(ASK)
        while time.monotonic() < deadline_s:
            match = _STATUS.fullmatch(self._line.receive(_POLL_S) or "")
            if match is None:
                continue
            place_m = _metres(match["place"])
            if offset := _OFFSET.search(match[0]):
                self._offset_m = _metres(offset[1])
            if match["kind"] == "W":
                return _Status(match["state"], match["phase"], place_m)
            if self._offset_m is not None:
                return _Status(match["state"], match["phase"], place_m - self._offset_m)
            self._line.send_byte(ASK)  # the offset comes with every few reports
        raise MachineError(f"The plotter on {self._line.port} does not say where it is; check the cable.")

    def _await_rest(self) -> None:
        known = np.isfinite(self._rates_m_s) & np.isfinite(self._accelerations_m_s2)
        rest_s = REST_S + float((self._rates_m_s[known] / self._accelerations_m_s2[known]).max(initial=0.0))
        deadline_s = time.monotonic() + rest_s
        while time.monotonic() < deadline_s:
            state, phase, _ = self._status()
            if state in ("Idle", "Alarm") or (state == "Hold" and phase == "0"):
                return
            time.sleep(_POLL_S)
        raise MachineError(
            f"The plotter on {self._line.port} did not come to rest within {rest_s:.3g} s of a feed hold."
        )

    def _was_woken(self) -> bool:
        """Whether the board greets by itself, because opening its port has reset it; one that runs tells its state."""
        deadline_s = time.monotonic() + _WAKE_S
        self._line.send_byte(ASK)
        while time.monotonic() < deadline_s:
            answer = self._line.receive(_POLL_S) or ""
            if _STATUS.fullmatch(answer):
                return False
            if self._is_greeting(answer):
                return True
        self._line.send_byte(RESET)
        self._await_greeting(ANSWER_S)
        return True

    def _is_greeting(self, answer: str) -> bool:
        if answer.startswith("Grbl") and not answer.startswith("Grbl 1.1"):
            raise MachineError(f"The plotter on {self._line.port} runs {answer!r}; this driver knows Grbl 1.1.")
        return answer.startswith("Grbl")

    def _await_greeting(self, within_s: float) -> None:
        deadline_s = time.monotonic() + within_s
        while time.monotonic() < deadline_s:
            if self._is_greeting(self._line.receive(_POLL_S) or ""):
                return
        raise MachineError(
            f"Nobody on {self._line.port} answered as GRBL within {within_s:g} s; check the port, the rate and the "
            "power."
        )

    def _checked_settings(self, lines: list[str]) -> dict[str, str]:
        settings = dict(line[1:].split("=", 1) for line in lines if line.startswith("$") and "=" in line)
        for number, (needed, reason) in _NEEDED.items():
            found = settings.get(number)
            if found is None or found.split()[0] != needed:
                raise MachineError(
                    f"The plotter on {self._line.port} has ${number}={found}, and {reason}; "
                    f"send ${number}={needed} to it."
                )
        return settings

    def _check_arrival(self, place_m: FloatArray) -> None:
        """Raise MachineError if the machine is not at the commanded place: a garbled line is detected only by this."""
        axes = slice(0, 3 if self._pen.kind == "z" else 2)
        here_m = self._status().place_m
        if np.abs(here_m - place_m)[axes].max() > _PLACE_M:
            raise MachineError(
                f"The plotter on {self._line.port} stands at {np.round(1000 * here_m[axes], 3).tolist()} mm and not at "
                f"{np.round(1000 * place_m[axes], 3).tolist()} mm: a line was lost or garbled on its way. "
                "Check the cable."
            )


def connect(rig: Rig) -> GrblPlotter:
    """The entry point `grbl`. The rig's [machine] has `port`, `baud` and the pen."""
    optional = frozenset({"servo_up", "servo_down"})
    check_keys(rig.machine, frozenset({"port", "baud", "pen"}), optional, f"[machine] of rig {rig.name}")
    pen_of(rig.machine, rig)  # before the port is opened
    line = SerialLine(rig.machine["port"], rig.machine["baud"])
    try:
        return GrblPlotter(line, rig)
    except BaseException:
        line.close()
        raise


def _values(settings: dict[str, str], numbers: tuple[str, ...]) -> FloatArray:
    """Settings of the axes, infinite where the controller tells no positive number."""
    values = []
    for number in numbers:
        try:
            value = float(settings[number].split()[0])
        except (KeyError, IndexError, ValueError):
            value = 0.0
        values.append(value if value > 0 else np.inf)
    return np.array(values)


def _metres(text: str) -> FloatArray:
    return np.array([float(value) / 1000 for value in text.split(",")[:3]])
