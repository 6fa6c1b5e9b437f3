"""A robot in its own process, which lifts the tool when the commanding process has ended.

A program that is killed cannot lift a tool any more. So another process holds the link to the hardware. When the
commanding process is gone, or sends nothing for too long, that process stops the motion, lifts the tool and ends.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.observations import Photo, Scan
from pentimento.robots.driver import Place, Push, Robot, SculptingRobot
from pentimento.robots.tools import EndEffector, Tool

FloatArray = NDArray[np.float64]
Ask = Callable[[str], None]
OpenRobot = Callable[..., Robot | SculptingRobot]
"""A function of a module, so that another process can import it: from arguments and an ``Ask`` to a robot."""

SILENT_S = 3.0
"""The tool is lifted when the commanding process has sent nothing for this time."""

_BEAT_S = 0.5
"""Time between two heartbeats; several fit into ``SILENT_S``."""
_JOIN_S = 10.0
"""Maximum time that ``close`` waits for the process to lift the tool and end."""


class RobotGone(PentimentoError):
    """The process that holds the robot has ended; it lifts the tool before it ends."""


class _DriverProcess:
    """The link to a driver in another process. Any thread may ``lift``."""

    def __init__(self, open_robot: OpenRobot, arguments: tuple[Any, ...], ask: Ask) -> None:
        """Start the process and open the robot there, by ``open_robot(*arguments, ask)``.

        Args:
            ask: shows the driver's requests to the person, in this process.

        Raises whatever opening the robot raises.
        """
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, open_robot, arguments), name="robot", daemon=True)
        self._process.start()
        theirs.close()  # so that the end of the other process closes the pipe
        self._ask = ask
        self._sending = threading.Lock()
        self._numbers = itertools.count()
        self._replies: dict[int, queue.SimpleQueue[tuple[bool, Any]]] = {}
        self._gone = threading.Event()
        threading.Thread(target=self._receive, name="robot's replies", daemon=True).start()
        threading.Thread(target=self._beat, name="robot's heartbeat", daemon=True).start()
        self._call("clock_s")  # raises why the robot could not be opened

    @property
    def clock_s(self) -> float:
        return float(self._call("clock_s"))

    def lift(self) -> None:
        self._call("lift")

    def wait(self, seconds: float) -> None:
        self._call("wait", seconds)

    def close(self) -> None:
        """End the process, which lifts the tool and closes the robot."""
        with suppress(RobotGone):  # it is closed already
            self._send((None, "close", ()))
        self._process.join(_JOIN_S)
        self._gone.set()
        self._connection.close()

    def _call(self, name: str, *arguments: Any) -> Any:
        number, reply = next(self._numbers), queue.SimpleQueue[tuple[bool, Any]]()
        self._replies[number] = reply
        self._send((number, name, arguments))
        while True:
            try:
                done, value = reply.get(timeout=_BEAT_S)
            except queue.Empty:
                if self._gone.is_set():
                    raise RobotGone("The process that holds the robot has ended; see that its tool is up.") from None
                continue
            if not done:
                raise value
            return value

    def _send(self, message: Any) -> None:
        with self._sending:
            try:
                self._connection.send(message)
            except OSError as error:
                raise RobotGone("The process that holds the robot has ended; see that its tool is up.") from error

    def _receive(self) -> None:
        while True:
            try:
                number, done, value = self._connection.recv()
            except (EOFError, OSError):
                self._gone.set()
                return
            if number is None:
                threading.Thread(target=self._forward, args=(value,), daemon=True).start()
            else:
                self._replies.pop(number).put((done, value))

    def _forward(self, request: str) -> None:
        """Show a request of the driver to the person, and send the reply back."""
        try:
            self._ask(request)
            self._send((None, "answered", (None,)))
        except (EOFError, KeyboardInterrupt, PentimentoError) as error:
            self._send((None, "answered", (f"The person did not confirm: {request} ({type(error).__name__})",)))

    def _beat(self) -> None:
        while not self._gone.wait(_BEAT_S):
            try:
                self._send((None, "beat", ()))
            except RobotGone:
                return


class RobotProcess(_DriverProcess):
    """A Robot whose driver runs in another process."""

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        width, height = self._call("canvas_size_m")
        return width, height

    def change_tool(self, tool: Tool) -> None:
        self._call("change_tool", tool)

    def load_palette(self, colors_srgb: FloatArray) -> None:
        self._call("load_palette", colors_srgb)

    def dip(self, paint: int) -> None:
        self._call("dip", paint)

    def wipe(self) -> None:
        self._call("wipe")

    def move(self, path: FloatArray) -> FloatArray:
        return np.asarray(self._call("move", path), dtype=np.float64)

    def force_n(self) -> FloatArray:
        return np.asarray(self._call("force_n"), dtype=np.float64)

    def photo(self) -> Photo:
        photo: Photo = self._call("photo")
        return photo

    def scan(self) -> FloatArray:
        return np.asarray(self._call("scan"), dtype=np.float64)

    def new_sheet(self) -> None:
        self._call("new_sheet")


class SculptingRobotProcess(_DriverProcess):
    """A SculptingRobot whose driver runs in another process."""

    @property
    def area_m(self) -> tuple[float, float]:
        width, height = self._call("area_m")
        return width, height

    def change_tool(self, end_effector: EndEffector) -> None:
        self._call("change_tool", end_effector)

    def push(self, push: Push) -> FloatArray:
        return np.asarray(self._call("push", push), dtype=np.float64)

    def place(self, place: Place) -> None:
        self._call("place", place)

    def scan(self) -> Scan:
        scan: Scan = self._call("scan")
        return scan

    def smooth(self) -> None:
        self._call("smooth")

    def ambient(self) -> dict[str, float]:
        readings: dict[str, float] = self._call("ambient")
        return readings


def _serve(connection: Connection, open_robot: OpenRobot, arguments: tuple[Any, ...]) -> None:
    """The other process: executes commands one after another in a thread, and lifts at once; lifts at its end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the commanding process
    sending, answered, work = threading.Lock(), queue.SimpleQueue[str | None](), queue.SimpleQueue[Any]()

    def send(message: Any) -> None:
        with sending:
            connection.send(message)

    def ask(request: str) -> None:
        send((None, True, request))
        refusal = answered.get()
        if refusal is not None:
            raise PentimentoError(refusal)

    try:
        robot = open_robot(*arguments, ask)
    except Exception as error:
        send((_next_number(connection), False, error))
        return

    def execute(number: int, name: str, arguments: tuple[Any, ...]) -> None:
        try:
            value = getattr(robot, name)
            reply = (number, True, value(*arguments) if callable(value) else value)
        except Exception as error:
            reply = (number, False, error)
        try:
            send(reply)
        except OSError:
            return  # the commanding process is gone; the reading thread notices it, too

    def commands() -> None:
        while True:
            execute(*work.get())

    threading.Thread(target=commands, name="commands", daemon=True).start()
    try:
        while connection.poll(SILENT_S):
            number, name, arguments = connection.recv()
            if name == "close":
                break
            if name == "answered":
                answered.put(arguments[0])
            elif name == "lift":  # not behind the command that is being executed
                threading.Thread(target=execute, args=(number, name, arguments), daemon=True).start()
            elif name != "beat":
                work.put((number, name, arguments))
    except (EOFError, OSError):
        pass  # the commanding process is gone
    try:
        robot.lift()
        getattr(robot, "close", lambda: None)()
    except Exception as error:  # a person must be told, whatever the error is
        print(f"pentimento: the tool may still rest on the canvas: {error}", file=sys.stderr, flush=True)
        os._exit(1)
    os._exit(0)  # a thread may still wait for a reply that never comes


def _next_number(connection: Connection) -> int:
    """The number of the next command that expects a reply."""
    while True:
        number, _, _ = connection.recv()
        if number is not None:
            return int(number)
