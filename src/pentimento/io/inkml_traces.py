"""The text of an InkML trace: points with a value for each channel, explicit or as differences (section 3.2.1)."""

from __future__ import annotations

import re
from typing import Final, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_VALUE: Final = re.compile(
    r"""[\s:]*([!'"]?)\s*([*?TF]|[-+]?\s*(?:\#[0-9A-Fa-f]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))[\s:;]*"""
)
_ORDERS: Final = {"!": 0, "'": 1, '"': 2}


class Channel(NamedTuple):
    """A channel of a trace format."""

    name: str
    element: Element
    regular: bool
    """Whether each point has a value of it; the others may end early."""


class _Decoder:
    """The values of one channel: a prefix holds until the next one."""

    def __init__(self) -> None:
        self._order = 0
        self._value = self._step = np.nan

    def next(self, prefix: str, text: str) -> float:
        if prefix:
            self._order = _ORDERS[prefix]
        if text in "?TF":  # not reported, or a button
            return np.nan
        if text == "*":
            if self._order:
                raise ValueError("* among differences is not supported; write the numbers")
            return self._value
        given = _number(text)
        if self._order and np.isnan(self._value):
            raise ValueError("a difference has no value before it")
        if self._order == 2:
            if np.isnan(self._step):
                raise ValueError("a second difference has no difference before it")
            self._step += given
        else:
            self._step = given if self._order else given - self._value
        self._value = self._value + self._step if self._order else given
        return self._value


def _number(text: str) -> float:
    text = "".join(text.split())
    sign, _, digits = text.rpartition("#")
    return float(text) if "#" not in text else float(int(f"{sign}{digits}", 16))


def decoded(text: str, channels: list[Channel]) -> dict[str, FloatArray]:
    """The values [K] of each channel by its name; NaN where there is none.

    Raises:
        ValueError: the text is no such trace; the message names the point.
    """
    decoders = [_Decoder() for _ in channels]
    needed = sum(channel.regular for channel in channels)
    parts = [part for part in text.split(",") if part.strip()]
    values = np.full((len(parts), len(channels)), np.nan)
    for number, part in enumerate(parts):
        place = count = 0
        while place < len(part):
            match = _VALUE.match(part, place)
            if match is None:
                raise ValueError(f"point {number} holds {part[place:].strip()[:20]!r}, which is no number")
            if count == len(channels):
                raise ValueError(f"point {number} has more values than the {len(channels)} channels")
            try:
                values[number, count] = decoders[count].next(match[1], match[2])
            except ValueError as error:
                raise ValueError(f"point {number}, channel {channels[count].name}: {error}") from error
            place, count = match.end(), count + 1
        if count < needed:
            raise ValueError(f"point {number} has {count} values for {needed} channels")
    return {channel.name: values[:, at] for at, channel in enumerate(channels)}
