"""Making a file bad: cut off, bits flipped, parts lost, doubled or blanked, and things that stand in no sound file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

_STRANGE: Final = (
    b"nan", b"-inf", b"1e999", b"-1", b"0", b"99999999999999999999", b"null", b"true", b'""', b"[]", b"{}", b"\x00",
    b"\xff\xfe", b"[" * 3000, b"{" * 500, b"&a [*a, *a]", b"!!python/object/apply:os.system [id]", b"../../etc/passwd",
    b"\n\n", b"\t", b",,,,", b"'", b'"', b"1 furlong", b"\xf0\x9f\x96\x8c",
)  # fmt: skip
_MAX_FLIPS: Final = 16
_LONGEST: Final = 64


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """A copy that differs from ``data``."""
    while True:
        worse = data
        for _ in range(int(rng.integers(1, 4))):
            worse = _WAYS[rng.integers(len(_WAYS))](worse, rng)
        if worse != data:
            return worse


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: _at(data, rng)]


def _flipped(data: bytes, rng: np.random.Generator) -> bytes:
    worse = bytearray(data)
    for _ in range(int(rng.integers(1, _MAX_FLIPS)) if worse else 0):
        worse[_at(data, rng)] ^= 1 << int(rng.integers(8))
    return bytes(worse)


def _without(data: bytes, rng: np.random.Generator) -> bytes:
    at, size = _at(data, rng), int(rng.integers(1, _LONGEST))
    return data[:at] + data[at + size :]


def _doubled(data: bytes, rng: np.random.Generator) -> bytes:
    at, size = _at(data, rng), int(rng.integers(1, _LONGEST))
    return data[: at + size] + data[at:]


def _blanked(data: bytes, rng: np.random.Generator) -> bytes:
    at = _at(data, rng)
    size = min(int(rng.integers(1, _LONGEST)), len(data) - at)
    return data[:at] + bytes(size) + data[at + size :]


def _strange(data: bytes, rng: np.random.Generator) -> bytes:
    at = _at(data, rng)
    replaced = int(rng.integers(0, 8))
    return data[:at] + _STRANGE[rng.integers(len(_STRANGE))] + data[at + replaced :]


def _shuffled(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    first, second = rng.integers(len(lines), size=2)
    lines[first], lines[second] = lines[second], lines[first]
    return b"\n".join(lines)


def _noise(data: bytes, rng: np.random.Generator) -> bytes:
    at = _at(data, rng)
    return data[:at] + rng.bytes(int(rng.integers(1, _LONGEST))) + data[at:]


def _at(data: bytes, rng: np.random.Generator) -> int:
    return int(rng.integers(len(data))) if data else 0


_WAYS: Final[tuple[Callable[[bytes, np.random.Generator], bytes], ...]] = (
    _cut, _flipped, _flipped, _without, _doubled, _blanked, _strange, _strange, _shuffled, _noise,
)  # fmt: skip
