"""Trying altered files on every reader, in another process: what ends it is a finding, too."""

from __future__ import annotations

import os
import signal
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import NoReturn

import numpy as np

from pentimento.contracts.errors import PentimentoError
from studies.fuzz.mutate import mutated
from studies.fuzz.target import Target
from studies.fuzz.targets import targets

_SLOW_S = 20
_CHUNK = 200


@dataclass
class Tally:
    """What came of the cases of one reader."""

    cases: int = 0
    refused: int = 0
    """With a sentence of ours."""
    sound: int = 0
    """Still a file that the reader takes: the change did not matter, or says something else that is sound."""
    crashes: Counter[str] = field(default_factory=Counter)
    """Anything else that was raised, and where; or the end of the process."""
    accepted: int = 0
    """Altered bytes that passed where none may."""
    mute: int = 0
    """Refused without a sentence."""

    def add(self, other: Tally) -> None:
        """Take another's cases in."""
        self.cases += other.cases
        self.refused += other.refused
        self.sound += other.sound
        self.crashes += other.crashes
        self.accepted += other.accepted
        self.mute += other.mute


def fuzz(cases: int, seed: int, bundle: Path | None) -> dict[str, Tally]:
    """Spread ``cases`` over all readers; case i of a reader depends on (seed, reader's name, i) alone."""
    with tempfile.TemporaryDirectory() as folder:
        names = [target.name for target in targets(Path(folder), bundle)]
    found = {name: Tally() for name in names}
    pool = _process()
    for name, first, last in _chunks(names, cases):
        try:
            found[name].add(pool.submit(tried, name, first, last, seed, bundle).result())
        except BrokenProcessPool:
            pool.shutdown()
            pool = _process()
            died = Tally(cases=last - first)
            died.crashes[f"the process died in cases {first} to {last - 1}"] += 1
            found[name].add(died)
    pool.shutdown()
    return found


def _process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"))


def _chunks(names: list[str], cases: int) -> Iterator[tuple[str, int, int]]:
    each = -(-cases // len(names))
    for name in names:
        for first in range(0, each, _CHUNK):
            yield name, first, min(first + _CHUNK, each)


def tried(name: str, first: int, last: int, seed: int, bundle: Path | None) -> Tally:
    """The cases ``first`` to ``last`` of one reader, here."""
    with tempfile.TemporaryDirectory() as folder, _Silence():
        target = next(target for target in targets(Path(folder), bundle) if target.name == name)
        if not target.must_refuse:
            for sound in target.sound:  # what is loaded for the first time is not on the clock
                target.attempt(sound)
        tally = Tally()
        for case in range(first, last):
            _try(target, case, seed, tally)
    return tally


def _try(target: Target, case: int, seed: int, tally: Tally) -> None:
    rng = np.random.default_rng([seed, *target.name.encode(), case])
    data = mutated(target.sound[case % len(target.sound)], rng)
    tally.cases += 1
    signal.signal(signal.SIGALRM, _too_slow)
    signal.alarm(_SLOW_S)
    try:
        target.attempt(data)
    except PentimentoError as error:
        tally.refused += 1
        tally.mute += not _is_sentence(str(error))
    except Exception as error:
        if type(error).__name__ == "SilentlyAccepted":
            tally.accepted += 1
        else:
            tally.crashes[f"{_where(error)} (case {case})"] += 1
    else:
        tally.accepted += target.must_refuse
        tally.sound += not target.must_refuse
    finally:
        signal.alarm(0)


def _is_sentence(text: str) -> bool:
    return len(text.split()) > 3 and text.rstrip().endswith((".", "?", ")"))


def _where(error: Exception) -> str:
    last = next(
        (f for f in reversed(traceback.extract_tb(error.__traceback__)) if "pentimento" in f.filename), None
    )  # fmt: skip
    place = f"{Path(last.filename).name}:{last.lineno}" if last else "?"
    return f"{type(error).__name__}: {str(error)[:80]!r} at {place}"


def _too_slow(*_: object) -> NoReturn:
    raise TimeoutError(f"more than {_SLOW_S} s")


class _Silence:
    """What C libraries say on stderr beside our sentences is not wanted in a study's output."""

    def __enter__(self) -> None:
        self._kept = os.dup(2)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        os.close(nowhere)

    def __exit__(self, *_: object) -> None:
        os.dup2(self._kept, 2)
        os.close(self._kept)
