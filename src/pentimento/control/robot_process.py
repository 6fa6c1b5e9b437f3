"""A robot in a process of its own, which lifts its tool when nobody commands it any more.

A program that is killed can do nothing more, least of all lift a tool. So what holds the link to hardware is another
process: when the one that commands it is gone, or has been silent for too long, it stops the motion, lifts, and ends.
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
from pentimento.contracts.photo import Photo
from pentimento.robots.driver import Robot
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]
Ask = Callable[[str], None]
Make = Callable[..., Robot]
"""A function of a module, so that another process finds it: from its arguments and an ``Ask`` to a robot."""

SILENT_S = 3.0
"""So long the commanding process may say nothing, before the tool is lifted."""

_BEAT_S = 0.5
_ENDS_S = 10.0


class RobotGone(PentimentoError):
    """The process that holds the robot has ended; it lifts the tool before it does."""


class RobotProcess:
    """A Robot whose driver runs in another process; see the module's text. Any thread may ``lift``."""

    def __init__(self, make: Make, arguments: tuple[Any, ...], ask: Ask) -> None:
        """Start the process and open the robot there, by ``make(*arguments, ask)``.

        Args:
            ask: puts the driver's requests to the person, here.

        Raises whatever opening the robot raises.
        """
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, make, arguments), name="robot", daemon=True)
        self._process.start()
        theirs.close()  # so that the end of the other process is an end of the pipe
        self._ask = ask
        self._sending = threading.Lock()
        self._numbers = itertools.count()
        self._answers: dict[int, queue.SimpleQueue[tuple[bool, Any]]] = {}
        self._gone = threading.Event()
        threading.Thread(target=self._receive, name="robot's answers", daemon=True).start()
        threading.Thread(target=self._beat, name="robot's heartbeat", daemon=True).start()
        self._call("canvas_size_m")  # opened, or raises why not

    @property
    def canvas_size_m(self) -> tuple[float, float]:
        width, height = self._call("canvas_size_m")
        return width, height

    @property
    def clock_s(self) -> float:
        return float(self._call("clock_s"))

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

    def lift(self) -> None:
        self._call("lift")

    def photo(self) -> Photo:
        photo: Photo = self._call("photo")
        return photo

    def scan(self) -> FloatArray:
        return np.asarray(self._call("scan"), dtype=np.float64)

    def new_sheet(self) -> None:
        self._call("new_sheet")

    def wait(self, seconds: float) -> None:
        self._call("wait", seconds)

    def close(self) -> None:
        """End the process, which lifts the tool and lets go of the robot."""
        with suppress(RobotGone):  # then it is closed
            self._send((None, "close", ()))
        self._process.join(_ENDS_S)
        self._gone.set()
        self._connection.close()

    def _call(self, name: str, *arguments: Any) -> Any:
        number, answer = next(self._numbers), queue.SimpleQueue[tuple[bool, Any]]()
        self._answers[number] = answer
        self._send((number, name, arguments))
        while True:
            try:
                done, value = answer.get(timeout=_BEAT_S)
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
                threading.Thread(target=self._put, args=(value,), daemon=True).start()
            else:
                self._answers.pop(number).put((done, value))

    def _put(self, request: str) -> None:
        """A request of the driver's to the person, and the answer back."""
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


def _serve(connection: Connection, make: Make, arguments: tuple[Any, ...]) -> None:
    """The other process: commands one after another in a thread, lifts at once, and a lift at the end of it all."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one who commands
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
        robot = make(*arguments, ask)
    except Exception as error:
        number, _, _ = _next_command(connection)
        send((number, False, error))
        return

    def obey(number: int, name: str, given: tuple[Any, ...]) -> None:
        try:
            value = getattr(robot, name)
            answer = (number, True, value(*given) if callable(value) else value)
        except Exception as error:
            answer = (number, False, error)
        try:
            send(answer)
        except OSError:
            return  # nobody is there to hear it; the reading thread notices, too

    def commands() -> None:
        while True:
            obey(*work.get())

    threading.Thread(target=commands, name="commands", daemon=True).start()
    try:
        while connection.poll(SILENT_S):
            number, name, given = connection.recv()
            if name == "close":
                break
            if name == "answered":
                answered.put(given[0])
            elif name == "lift":  # past whatever is on its way
                threading.Thread(target=obey, args=(number, name, given), daemon=True).start()
            elif name != "beat":
                work.put((number, name, given))
    except (EOFError, OSError):
        pass  # the other side is gone, which is what this waits for
    try:
        robot.lift()
        getattr(robot, "close", lambda: None)()
    except Exception as error:  # whatever it is, a person has to know
        print(f"pentimento: the tool may still rest on the canvas: {error}", file=sys.stderr, flush=True)
        os._exit(1)
    os._exit(0)  # a thread may still wait for an answer that will never come


def _next_command(connection: Connection) -> tuple[int, str, tuple[Any, ...]]:
    while True:
        number, name, given = connection.recv()
        if number is not None:
            return number, name, given
