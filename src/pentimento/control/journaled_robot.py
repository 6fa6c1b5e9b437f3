"""A virtual robot whose world outlives the process that paints in it.

Paper stays where it is when a computer goes down. A studio's paper is memory of a process, so every command is written
to a journal before it is made; another process makes the commands of the journal again, and since a studio gives the
same bytes for the same commands, it stands before the same sheet. The last command may be one that the process which
died never heard back from, as with a real robot.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.photo import Photo
from pentimento.control.journal import Journal
from pentimento.robots.driver import Robot
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]


class JournaledRobot:
    """A deterministic Robot with a journal of its commands."""

    def __init__(self, robot: Robot, journal: Path, load: Callable[[str], Tool]) -> None:
        """Make the commands of the journal, if there is one, with a robot that has made none.

        Args:
            load: a tool by its name, for journals that change tools.

        Raises:
            ContractError: the journal is not one.
        """
        self._robot, self._load = robot, load
        self._journal = Journal(journal, self._obey)

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        return self._robot.canvas_size_m

    @property
    def clock_s(self) -> float:
        return self._robot.clock_s

    def change_tool(self, tool: Tool) -> None:
        self._do("change_tool", tool.name)

    def load_palette(self, colors_srgb: FloatArray) -> None:
        self._do("load_palette", np.asarray(colors_srgb).tolist())

    def dip(self, paint: int) -> None:
        self._do("dip", paint)

    def wipe(self) -> None:
        self._do("wipe")

    def move(self, path: FloatArray) -> FloatArray:
        return self._do("move", np.asarray(path).tolist())

    def lift(self) -> None:
        self._robot.lift()

    def photo(self) -> Photo:
        return self._do("photo")

    def scan(self) -> FloatArray:
        return self._do("scan")

    def new_sheet(self) -> None:
        self._do("new_sheet")

    def wait(self, seconds: float) -> None:
        self._do("wait", seconds)

    def close(self) -> None:
        """Close the journal, and the robot where it can be closed."""
        self._journal.close()
        close = getattr(self._robot, "close", None)
        if close is not None:
            close()

    def _do(self, name: str, *arguments: Any) -> Any:
        return self._journal.do(name, *arguments)

    def _obey(self, name: str, arguments: list[Any]) -> Any:
        if name == "change_tool":
            return self._robot.change_tool(self._load(arguments[0]))
        given = [np.array(value) if isinstance(value, list) else value for value in arguments]
        return getattr(self._robot, name)(*given)
