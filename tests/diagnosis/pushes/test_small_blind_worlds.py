"""Two small blind clay worlds: what is hidden is named, and nothing else. `make studies` has the large table.

The strength is such that 60 pushes show it; finding one that gives a wanted q takes most of what a world of the large
table costs.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from studies.blind.pushes.collect import as_table, decoys, recorded_rows
from studies.blind.pushes.verdict_of import verdict_on
from studies.blind.pushes.worlds import sketch_world

WORLDS: tuple[tuple[int, str | None, float], ...] = ((1, "tool_backlash", 1.5), (4, None, 0.0))
"""Seed, hidden cause, its strength."""


def hidden_and_named(seed: int, cause: str | None, strength: float) -> tuple[set[str], set[str]]:
    """What a world hides, and what the verdict on its table establishes."""
    sketch = sketch_world("none" if cause is None else "one", seed, cause)
    small = replace(sketch, config=replace(sketch.config, pushes=60, repeated=9, times=2))
    rows = recorded_rows(small, small.with_strengths({} if cause is None else {cause: strength}), seed)
    said, _ = verdict_on(as_table(rows, decoys(len(rows), seed)), 0)
    return set(small.causes), {entry["cause"] for entry in said["established"]}


@pytest.mark.timeout(600)
def test_small_worlds_are_named_and_none_falsely() -> None:
    found = [hidden_and_named(*world) for world in WORLDS]
    assert all(hidden == named for hidden, named in found), found
