"""A person's word while the robot paints (pause, your turn, go on, stop): said from any thread, heard between
strokes."""

from __future__ import annotations

import threading
from typing import Final, Literal

Word = Literal["pause", "your turn", "go on", "stop"]

WORDS: Final[tuple[Word, ...]] = ("pause", "your turn", "go on", "stop")


class Control:
    """The last word that was said and not yet heard."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._word: Word | None = None

    def say(self, word: Word) -> None:
        """A later word takes the place of an earlier one, but nothing takes the place of ``stop``."""
        with self._changed:
            if self._word != "stop":
                self._word = word
            self._changed.notify_all()

    def heard(self) -> Word | None:
        """The word since the last time, if any."""
        with self._changed:
            word, self._word = self._word, None
            return word

    def wait(self) -> Word:
        """The next word, whenever it comes."""
        with self._changed:
            self._changed.wait_for(lambda: self._word is not None)
            word, self._word = self._word, None
            assert word is not None
            return word
