"""Worlds of simulators that the finder was not made with: each is made, judged by its table alone, and kept."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Protocol, TypeVar

import pyarrow as pa

from pentimento.contracts.atomic import atomic_write
from studies.blind.truth import write_parquet


class OtherWorld(Protocol):
    """What is known of one."""

    @property
    def name(self) -> str:
        """For people."""

    @property
    def seed(self) -> int:
        """No two have the same."""

    @property
    def truth(self) -> frozenset[str]:
        """What the finder should name."""


W = TypeVar("W", bound=OtherWorld)


def verdicts(
    worlds: Iterable[W], recorded: Callable[[W], pa.Table], judged: Callable[[Path], dict[str, Any]], out: Path
) -> dict[W, dict[str, Any]]:
    """What is said of each world whose table alone is ``judged``; worlds that have a verdict in ``out`` are not judged
    again.
    """
    out.mkdir(parents=True, exist_ok=True)
    said = {}
    for world in worlds:
        kept = out / f"{world.seed}.json"
        if not kept.exists():
            with tempfile.TemporaryDirectory() as folder:
                table = Path(folder) / "table.parquet"
                write_parquet(table, recorded(world))
                atomic_write(kept, (json.dumps(judged(table)) + "\n").encode())
        said[world] = json.loads(kept.read_text())
        print(f"{world.name}: hidden {listed(world.truth)}, named {listed(named(said[world]))}", flush=True)
    return said


def named(result: dict[str, Any]) -> frozenset[str]:
    """What a verdict says is established."""
    return frozenset(entry["cause"] for entry in result["verdict"]["established"])


def rivals(result: dict[str, Any]) -> list[str]:
    """What it says could stand in the place of that."""
    return sorted({rival for entry in result["verdict"]["established"] for rival in entry["rivals"]})


def share_closed(result: dict[str, Any]) -> str:
    """Of the gap on sealed actions, for people."""
    closed = result["verdict"]["gap_closed"]["test"]
    return "–" if closed is None or not named(result) else f"{closed:.2f}"


def listed(causes: Iterable[str]) -> str:
    """For people."""
    return ", ".join(sorted(causes)) or "nothing"
