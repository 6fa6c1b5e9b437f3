"""The heartbeat: a loop that is late finds its tool lifted and its robot stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from pentimento.contracts.errors import PentimentoError

_LOOKS_S = 0.02
"""Between two looks at the clock: so much later than due a stop may come."""


class Watchdog:
    """Stops a robot when the loop that commands it has not beaten in time.

    Before whatever it does next, the loop says by ``beat`` how long that may take. A thread watches; where the next
    beat is late, it calls ``stop`` with a sentence, once, from its own thread: the robot must bear that (see
    ``robots.driver.Robot.lift``) and stay stopped. What is stopped is not released here.
    """

    def __init__(
        self, stop: Callable[[str], None], clock: Callable[[], float] = time.monotonic, looks_s: float = _LOOKS_S
    ) -> None:
        self._stop, self._clock = stop, clock
        self._lock = threading.Lock()
        self._due: tuple[float, float, str] | None = None  # when, how long it was given, for what
        self._closed = threading.Event()
        self.failure: PentimentoError | None = None
        """Why the tool could not be lifted, if so."""
        self._thread = threading.Thread(target=self._watch, args=(looks_s,), name="watchdog", daemon=True)
        self._thread.start()

    def beat(self, within_s: float, what: str) -> None:
        """The loop is alive, and will beat again within ``within_s`` seconds: that long ``what`` may take."""
        with self._lock:
            self._due = (self._clock() + within_s, within_s, what)

    def rest(self) -> None:
        """The tool is up and nothing moves until the next beat, which may take any time: a person's turn."""
        with self._lock:
            self._due = None

    def look(self) -> bool:
        """Whether the beat was late, in which case the robot is stopped now. The thread calls it; tests may."""
        with self._lock:
            due = self._due
            if due is None or self._clock() <= due[0]:
                return False
            self._due = None
        _, given_s, what = due
        try:
            self._stop(f"{what} took longer than the {given_s:.3g} s that it may take")
        except PentimentoError as error:
            self.failure = error
        return True

    def close(self) -> None:
        """Watch no more."""
        self._closed.set()
        self._thread.join()

    def _watch(self, looks_s: float) -> None:
        while not self._closed.wait(looks_s):
            self.look()
