"""Worlds of independent simulators: each is made, diagnosed from its table alone, and its verdict is kept."""

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
    """A world of another simulator."""

    @property
    def name(self) -> str:
        """Shown on the page."""

    @property
    def seed(self) -> int:
        """Unique."""

    @property
    def truth(self) -> frozenset[str]:
        """The causes that a diagnosis should name."""


W = TypeVar("W", bound=OtherWorld)


def verdicts(
    worlds: Iterable[W], recorded: Callable[[W], pa.Table], diagnosed: Callable[[Path], dict[str, Any]], out: Path
) -> dict[W, dict[str, Any]]:
    """The result of ``diagnosed`` for each world's table; worlds that have a verdict in ``out`` are not diagnosed
    again."""
    out.mkdir(parents=True, exist_ok=True)
    results = {}
    for world in worlds:
        kept = out / f"{world.seed}.json"
        if not kept.exists():
            with tempfile.TemporaryDirectory() as folder:
                table = Path(folder) / "table.parquet"
                write_parquet(table, recorded(world))
                atomic_write(kept, (json.dumps(diagnosed(table)) + "\n").encode())
        results[world] = json.loads(kept.read_text())
        print(f"{world.name}: hidden {listed(world.truth)}, named {listed(named(results[world]))}", flush=True)
    return results


def named(result: dict[str, Any]) -> frozenset[str]:
    """The established causes of a verdict."""
    return frozenset(entry["cause"] for entry in result["verdict"]["established"])


def rivals(result: dict[str, Any]) -> list[str]:
    """The rivals of the established causes."""
    return sorted({rival for entry in result["verdict"]["established"] for rival in entry["rivals"]})


def share_closed(result: dict[str, Any]) -> str:
    """The fraction of the gap closed on the test split, in words."""
    closed = result["verdict"]["gap_closed"]["test"]
    return "–" if closed is None or not named(result) else f"{closed:.2f}"


def listed(causes: Iterable[str]) -> str:
    """The causes in words."""
    return ", ".join(sorted(causes)) or "nothing"
