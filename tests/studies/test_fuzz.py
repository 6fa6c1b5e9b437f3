"""Altered files: a few hundred on every reader, and that the study would notice what it looks for."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError, PentimentoError
from studies.fuzz.mutate import mutated
from studies.fuzz.run import Tally, _try
from studies.fuzz.target import Target
from studies.fuzz.targets import targets
from tests.bundle.tiny_bundle import write_tiny_bundle

EACH = 12


def tallied(target: Target, cases: int) -> Tally:
    tally = Tally()
    for case in range(cases):
        _try(target, case, 0, tally)
    return tally


def test_every_reader_takes_its_sound_files_and_says_no_to_bad_ones_in_sentences(tmp_path: Path) -> None:
    found: dict[str, Tally] = {}
    for target in targets(tmp_path / "read", write_tiny_bundle(tmp_path / "bundle")):
        if not target.must_refuse:
            for sound in target.sound:
                target.attempt(sound)
        found[target.name] = tallied(target, EACH)
    total = sum(tally.cases for tally in found.values())
    assert total >= 300 and sum(tally.refused for tally in found.values()) > total / 2
    assert {name: tally.crashes for name, tally in found.items() if tally.crashes} == {}
    assert [name for name, tally in found.items() if tally.accepted or tally.mute] == []


def bad(_: bytes) -> Any:
    raise KeyError("not ours")


def mute(_: bytes) -> Any:
    raise ContractError("no")


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        (Target("crashes", (b"abc",), bad), Tally(3, crashes=Counter())),
        (Target("says nothing", (b"abc",), mute), Tally(3, refused=3, mute=3)),
        (Target("takes all", (b"abc",), len), Tally(3, sound=3)),
        (Target("takes all and may not", (b"abc",), len, must_refuse=True), Tally(3, accepted=3)),
    ],
    ids=lambda value: value.name if isinstance(value, Target) else "",
)
def test_what_is_wrong_is_counted(target: Target, expected: Tally) -> None:
    tally = tallied(target, 3)
    if target.name == "crashes":
        assert sum(tally.crashes.values()) == 3 and all("KeyError" in crash for crash in tally.crashes)
        tally.crashes.clear()
    assert tally == expected


def test_an_altered_file_differs_and_is_the_same_every_time() -> None:
    data = bytes(range(200))
    first = [mutated(data, np.random.default_rng(case)) for case in range(60)]
    assert first == [mutated(data, np.random.default_rng(case)) for case in range(60)]
    assert data not in first and len(set(first)) > 50
    assert {len(worse) < len(data) for worse in first} == {True, False}


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("plan", b"[" * 100_000 + b"\n"),
        ("mesh", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n"),
        ("mesh", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n"),
        ("tool", b'name = "\xff"\n'),
        ("world", b'base = "\xff"\n'),
        ("end-effector", b'name = "\xff"\n'),
        ("height map", b"\x93NUMPY\x01\x00\x10\x00{'descr': (\n      "),
    ],
)
def test_what_once_crashed_a_reader_is_refused(name: str, data: bytes, tmp_path: Path) -> None:
    reader = next(target for target in targets(tmp_path, None) if target.name == name)
    with pytest.raises(PentimentoError, match=r"\.$"):
        reader.attempt(data)
