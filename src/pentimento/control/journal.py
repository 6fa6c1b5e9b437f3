"""Virtual robots whose world survives the process that works in it.

The paper and clay of a studio are memory of a process. So every command is written to a journal before it is executed.
Another process executes the journal's commands again; since a studio is deterministic, its world is the same then. The
last command of a journal may be one whose result the failed process never received, as with a real robot.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.observations import Photo, Scan
from pentimento.robots.driver import Place, Push, Robot, SculptingRobot
from pentimento.robots.tools import EndEffector, Tool

FloatArray = NDArray[np.float64]
Execute = Callable[[str, list[Any]], Any]
"""Executes a command, given by its name and plain arguments."""


class Journal:
    """Commands as lines of JSON, ``[name, [arguments]]``; each is on disk before it is executed."""

    def __init__(self, path: Path, execute: Execute) -> None:
        """Execute the commands of the journal again, if there is one.

        Raises:
            ContractError: the file is not a journal.
        """
        self._execute = execute
        path.parent.mkdir(parents=True, exist_ok=True)
        text = path.read_bytes() if path.exists() else b""
        whole = text[: text.rfind(b"\n") + 1]  # a truncated line was never executed
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                name, arguments = json.loads(line)
            except ValueError as error:
                raise ContractError(f"Line {number} of the journal {path} is damaged; start a new one.") from error
            with suppress(PentimentoError):  # a command that was refused is refused again and changes nothing
                execute(name, arguments)
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        os.ftruncate(self._file, len(whole))
        os.lseek(self._file, len(whole), os.SEEK_SET)

    def do(self, name: str, *arguments: Any) -> Any:
        """Write a command with its plain arguments, then execute it.

        Raises:
            OSError: it cannot be written, and was not executed.
        """
        line = (json.dumps([name, arguments]) + "\n").encode()
        start = os.lseek(self._file, 0, os.SEEK_CUR)
        try:
            if os.write(self._file, line) != len(line):
                raise OSError(f"The journal of the virtual robot takes no more than {start} bytes: the disk is full.")
        except OSError:
            os.ftruncate(self._file, start)
            os.lseek(self._file, start, os.SEEK_SET)
            raise
        return self._execute(name, list(arguments))

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


class JournaledRobot:
    """A deterministic Robot with a journal of its commands."""

    def __init__(self, robot: Robot, journal: Path, load: Callable[[str], Tool]) -> None:
        """Execute the journal's commands, if there is one, with a robot that has executed none.

        Args:
            load: a tool by its name, for journals that change tools.

        Raises:
            ContractError: the file is not a journal.
        """
        self._robot, self._load = robot, load
        self._journal = Journal(journal, self._execute)

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._robot.canvas_size_m

    @property
    def clock_s(self) -> float:
        return self._robot.clock_s

    def change_tool(self, tool: Tool) -> None:
        self._journal.do("change_tool", tool.name)

    def load_palette(self, colors_srgb: FloatArray) -> None:
        self._journal.do("load_palette", np.asarray(colors_srgb).tolist())

    def dip(self, paint: int) -> None:
        self._journal.do("dip", paint)

    def wipe(self) -> None:
        self._journal.do("wipe")

    def move(self, path: FloatArray) -> FloatArray:
        measured: FloatArray = self._journal.do("move", np.asarray(path).tolist())
        return measured

    def force_n(self) -> FloatArray:
        return self._robot.force_n()

    def lift(self) -> None:
        self._robot.lift()

    def photo(self) -> Photo:
        photo: Photo = self._journal.do("photo")
        return photo

    def scan(self) -> FloatArray:
        heights: FloatArray = self._journal.do("scan")
        return heights

    def new_sheet(self) -> None:
        self._journal.do("new_sheet")

    def wait(self, seconds: float) -> None:
        self._journal.do("wait", seconds)

    def close(self) -> None:
        """Close the journal, and the robot where it can be closed."""
        self._journal.close()
        close = getattr(self._robot, "close", None)
        if close is not None:
            close()

    def _execute(self, name: str, arguments: list[Any]) -> Any:
        if name == "change_tool":
            return self._robot.change_tool(self._load(arguments[0]))
        arrays = [np.array(value) if isinstance(value, list) else value for value in arguments]
        return getattr(self._robot, name)(*arrays)


class JournaledClay:
    """A deterministic SculptingRobot with a journal of its commands."""

    def __init__(self, robot: SculptingRobot, journal: Path, load: Callable[[str], EndEffector]) -> None:
        """Execute the journal's commands, if there is one, with a robot that has executed none.

        Args:
            load: an end-effector by its name.

        Raises:
            ContractError: the file is not a journal.
        """
        self._robot, self._load = robot, load
        self._journal = Journal(journal, self._execute)

    @property
    def area_m(self) -> tuple[float, float]:
        return self._robot.area_m

    @property
    def clock_s(self) -> float:
        return self._robot.clock_s

    def change_tool(self, end_effector: EndEffector) -> None:
        self._journal.do("change_tool", end_effector.name)

    def push(self, push: Push) -> FloatArray:
        numbers = map(float, (push.surface_m, push.speed_m_s, push.dwell_s, push.retract_speed_m_s))
        measured: FloatArray = self._journal.do("push", push.kind, np.asarray(push.action).tolist(), *numbers)
        return measured

    def place(self, place: Place) -> None:
        numbers = (place.x_m, place.y_m, place.volume_m3, place.surface_m, place.press_m)
        self._journal.do("place", *map(float, numbers))

    def lift(self) -> None:
        self._robot.lift()

    def scan(self) -> Scan:
        scan: Scan = self._journal.do("scan")
        return scan

    def smooth(self) -> None:
        self._journal.do("smooth")

    def ambient(self) -> dict[str, float]:
        return self._robot.ambient()

    def wait(self, seconds: float) -> None:
        self._journal.do("wait", seconds)

    def close(self) -> None:
        """Close the journal."""
        self._journal.close()

    def _execute(self, name: str, arguments: list[Any]) -> Any:
        match name:
            case "change_tool":
                return self._robot.change_tool(self._load(arguments[0]))
            case "push":
                kind, action, *numbers = arguments
                return self._robot.push(Push(kind, np.array(action, dtype=np.float64), *numbers))
            case "place":
                return self._robot.place(Place(*arguments))
            case _:
                return getattr(self._robot, name)(*arguments)
