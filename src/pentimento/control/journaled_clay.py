"""A virtual sculpting robot whose clay outlives the process that works on it (as ``lasting.py``, for paper)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.scan import Scan
from pentimento.control.journal import Journal
from pentimento.robots.end_effectors import EndEffector
from pentimento.robots.sculpting import Push, SculptingRobot

FloatArray = NDArray[np.float64]


class JournaledClay:
    """A deterministic SculptingRobot with a journal of its commands.

    The last command of a journal may be one that the process which died never heard back from, as with a real robot.
    """

    def __init__(self, robot: SculptingRobot, journal: Path, load: Callable[[str], EndEffector]) -> None:
        """Make the commands of the journal, if there is one, with a robot that has made none.

        Args:
            load: an end-effector by its name.

        Raises:
            ContractError: the journal is not one.
        """
        self._robot, self._load = robot, load
        self._journal = Journal(journal, self._obey)

    @property
    def area_m(self) -> tuple[float, float]:
        return self._robot.area_m

    @property
    def clock_s(self) -> float:
        return self._robot.clock_s

    def change_tool(self, end_effector: EndEffector) -> None:
        self._journal.do("change_tool", end_effector.name)

    def push(self, push: Push) -> FloatArray:
        told = (push.surface_m, push.speed_m_s, push.dwell_s, push.retract_speed_m_s)
        measured: FloatArray = self._journal.do("push", push.kind, np.asarray(push.action).tolist(), *map(float, told))
        return measured

    def scan(self) -> Scan:
        seen: Scan = self._journal.do("scan")
        return seen

    def smooth(self) -> None:
        self._journal.do("smooth")

    def ambient(self) -> dict[str, float]:
        return self._robot.ambient()

    def wait(self, seconds: float) -> None:
        self._journal.do("wait", seconds)

    def close(self) -> None:
        """Close the journal."""
        self._journal.close()

    def _obey(self, name: str, arguments: list[Any]) -> Any:
        match name:
            case "change_tool":
                return self._robot.change_tool(self._load(arguments[0]))
            case "push":
                kind, action, *numbers = arguments
                return self._robot.push(Push(kind, np.array(action, dtype=np.float64), *numbers))
            case _:
                return getattr(self._robot, name)(*arguments)
