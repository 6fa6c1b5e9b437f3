"""How the stages of `make repro` are doing: their states, what is left to do, and why one failed."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from pentimento.contracts.atomic import atomic_write

AT_ONCE = 2
"""Stages that run at a time."""
Reads = Mapping[str, frozenset[str]]
"""By stage: the stages whose outputs it reads."""
LOGS = Path(".pentimento/logs")
"""The output of each stage's last run."""
_DURATIONS = Path(".pentimento/durations.json")
_UNCHANGED = ("didn't change, skipping", "is cached - skipping run")  # as DVC says it


class State(StrEnum):
    """Of a stage."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    UNCHANGED = "unchanged"
    FAILED = "failed"


@dataclass(frozen=True)
class Row:
    """One stage, as the progress shows it."""

    stage: str
    state: State
    seconds: float | None = None
    """So far, or in total; None before it starts and where it need not run."""
    expected_s: float | None = None
    """What its last run took; None before the first."""
    picture: Path | None = None
    """The newest of its pictures."""


def read_durations(folder: Path) -> dict[str, float]:
    """Return the seconds of each stage's last run in `folder`; empty where there was none."""
    try:
        return {
            str(name): float(seconds)
            for name, seconds in json.loads((folder / _DURATIONS).read_text(encoding="utf-8")).items()
        }
    except (OSError, ValueError, AttributeError, TypeError):
        return {}  # only the forecast is missing


def write_durations(folder: Path, durations: Mapping[str, float]) -> None:
    """Keep the seconds of each stage's last run for the next one's forecast."""
    (folder / _DURATIONS).parent.mkdir(parents=True, exist_ok=True)
    rounded = {name: round(seconds, 1) for name, seconds in durations.items()}
    atomic_write(folder / _DURATIONS, json.dumps(rounded, indent=1, sort_keys=True).encode())


def remaining_s(rows: Sequence[Row], reads: Reads) -> float | None:
    """Return the seconds until all stages are done if each takes as long as last time; None where that is unknown.

    `rows` are in the order in which waiting stages start; a stage starts when one of `AT_ONCE` places is free and the
    stages that it reads are done.
    """
    open_rows = [row for row in rows if row.state in (State.RUNNING, State.WAITING)]
    lengths = {row.stage: max(0.0, row.expected_s - (row.seconds or 0.0)) for row in open_rows if row.expected_s}
    if len(lengths) < len(open_rows):
        return None
    clock = 0.0
    ends = {row.stage: lengths[row.stage] for row in open_rows if row.state is State.RUNNING}
    waiting = [row.stage for row in open_rows if row.state is State.WAITING]
    while waiting or ends:
        ready = [name for name in waiting if not reads[name] & {*waiting, *ends}][: AT_ONCE - len(ends)]
        if not ready and not ends:
            return None  # a cycle, which DVC refuses
        for name in ready:
            ends[name] = clock + lengths[name]
            waiting.remove(name)
        first = min(ends, key=lambda name: ends[name])
        clock = ends.pop(first)
    return clock


def ended_state(status: int, lines: Sequence[str]) -> State:
    """Return the state of a stage whose DVC process ended with `status` and printed `lines`."""
    if status != 0:
        return State.FAILED
    by_dvc = [line for line in lines if line.startswith("Stage ")]
    return State.UNCHANGED if any(said in line for said in _UNCHANGED for line in by_dvc) else State.DONE


def failure_sentence_in(lines: Sequence[str]) -> str:
    """Return the line of a failed stage's output that says why: the last one before DVC's own."""
    said = [line.strip() for line in lines if line.strip()]
    own = [line for line in said if not line.startswith(("ERROR: ", "> ", "Running stage"))]
    return (own or said or ["It ended without a word."])[-1]


def newest_picture(outs: Sequence[Path]) -> Path | None:
    """Return the newest PNG among a stage's outputs, those at their top before those in their folders; None if none."""
    for pattern in ("*.png", "**/*.png"):
        found = [file for out in outs if out.is_dir() for file in out.glob(pattern)]
        if found:
            return max(found, key=lambda file: (file.stat().st_mtime_ns, file.name))
    return None
