"""Runs two stages at a time: `dvc repro` alone runs one after the other, and many stages use one core.

DVC itself runs each stage (`dvc repro --single-item`) as soon as its inputs are there. Of the stages that are ready,
the one with the longest chain of dependent stages comes first.
"""

import json
import os
import re
import signal
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from subprocess import PIPE, STDOUT
from typing import IO, NamedTuple, cast

from pentimento.contracts.errors import PentimentoError
from pipelines._dvc import Process, ask_dvc, run_dvc, send, signals_passed_on, start_dvc
from pipelines._progress import (
    AT_ONCE,
    LOGS,
    Reads,
    Row,
    State,
    ended_state,
    failure_sentence_in,
    newest_picture,
    read_durations,
    remaining_s,
    write_durations,
)
from pipelines._progress_views import View
from pipelines._tracking.dvc_files import outputs_by_stage

_POLL_S = 0.1
_EDGE = re.compile(r'^\s*"([^"]+)" -> "([^"]+)";$', re.MULTILINE)
_NODE = re.compile(r'^\s*"([^"]+)"', re.MULTILINE)


class Outcome(NamedTuple):
    """How a run of the pipeline ended."""

    status: int
    """DVC's exit status, 130 or 143 after a signal."""
    unfinished: frozenset[str]
    """Stage items that are still out of date."""


def bring_up_to_date(folder: Path, view: View, targets: Collection[str] = ()) -> Outcome:
    """Run the out-of-date stages of the pipeline in `folder`; of `targets`, if any, only them and what they read."""
    status = ask_dvc(["status", "--json"], folder)
    if not status:  # the pipeline is invalid (a cycle, an unreadable file): DVC reports it
        return Outcome(run_dvc(["repro"], folder), frozenset())
    changed = [name for name in json.loads(status) if not _of_other_pipeline(name)]
    if not changed:
        view.note("Data and pipelines are up to date.")
        return Outcome(0, frozenset())
    dot = ask_dvc(["dag", "--dot"], folder)
    known = [name for name in dict.fromkeys(_NODE.findall(dot)) if not _of_other_pipeline(name)]
    reads = out_of_date(dict.fromkeys(changed), dot)
    wanted = needed_by(targets, dot) if targets else frozenset(known)
    to_run = {name: read for name, read in reads.items() if name in wanted}
    if not to_run:
        view.note(f"{', '.join(sorted(targets))}: up to date.")
        return Outcome(0, frozenset(reads))
    ended, done = _run_all(to_run, [name for name in known if name in wanted], folder, view)
    return Outcome(ended, frozenset(reads.keys() - done))


def items_of(target: str, folder: Path) -> list[str]:
    """Return the stage items of dvc.yaml in `folder` that `target` names: a stage (all of its items) or stage@item.

    Raises:
        PentimentoError: there is no such stage item.
    """
    known = outputs_by_stage(folder)
    found = [name for name in known if target in (name, name.partition("@")[0])]
    if found:
        return found
    stage = target.partition("@")[0]
    items = [name for name in known if name.partition("@")[0] == stage]
    stages = {name.partition("@")[0] for name in known}
    close = items or get_close_matches(target, known.keys() | stages) or sorted(stages)
    raise PentimentoError(f"there is no stage {target!r} in {folder / 'dvc.yaml'}; there is {', '.join(close)}.")


def needed_by(targets: Collection[str], dot: str) -> frozenset[str]:
    """Return `targets` and all stages that they read, directly or by others; `dot` as in `out_of_date`."""
    edges = _EDGE.findall(dot)
    found, new = set[str](), set(targets)
    while new:
        found |= new
        new = {stage for stage, reader in edges if reader in found} - found
    return frozenset(found)


def out_of_date(changed: Mapping[str, object], dot: str) -> Reads:
    """Return the stages of the folder's own dvc.yaml that must run, and which of them each one reads.

    Stages of dvc.yaml files in other folders, which DVC lists as `file:stage`, belong to other pipelines.

    Parameters
    ----------
    changed
        The changes of each stage that is out of date by itself (`dvc status --json`).
    dot
        The graph of the pipeline (`dvc dag --dot`), with edges from a stage to those that read it.
    """
    edges = _EDGE.findall(dot)
    found, new = set[str](), {name for name in changed if not _of_other_pipeline(name)}
    while new:
        found |= new
        new = {reader for stage, reader in edges if stage in found} - found
    return {name: frozenset(stage for stage, reader in edges if reader == name and stage in found) for name in found}


def in_order(reads: Reads) -> list[str]:
    """Sort stages by the length of their longest chain of dependent stages, then by name."""

    @cache
    def below(name: str) -> int:
        return max((1 + below(reader) for reader, read in reads.items() if name in read), default=0)

    return sorted(reads, key=lambda name: (-below(name), name))


def _of_other_pipeline(name: str) -> bool:
    """Whether a stage is of a dvc.yaml in another folder."""
    return ":" in name


@dataclass(frozen=True)
class _Running:
    """A stage that runs."""

    process: Process
    reader: threading.Thread
    started: float
    lines: list[str]
    """Printed so far."""


def _run_all(reads: Reads, known: list[str], folder: Path, view: View) -> tuple[int, set[str]]:
    """Run the stages of `reads`, `AT_ONCE` at a time, until all are done or one has failed; then stop the other.

    Those of the stages `known` that are not in `reads` are up to date. Returns the exit status and the stages that are
    up to date now.
    """
    os.environ["OMP_WAIT_POLICY"] = "PASSIVE"  # threads that spin while they wait take the other stage's core
    os.environ["PYTHONUNBUFFERED"] = "1"  # or the output of a stage arrives in one piece when it ends
    durations, order = read_durations(folder), in_order(reads)
    outs = {name: [folder / path for path in paths] for name, paths in outputs_by_stage(folder).items()}
    rows = {name: Row(name, State.WAITING, expected_s=durations.get(name)) for name in order}
    unchanged = {name: newest_picture(outs.get(name, ())) for name in known if name not in rows}
    rows |= {name: Row(name, State.UNCHANGED, picture=picture) for name, picture in unchanged.items()}
    running, processes = dict[str, _Running](), list[Process]()
    status = 0
    with signals_passed_on(processes) as received:
        while status == 0 and not received:
            done = {name for name, row in rows.items() if row.state in (State.DONE, State.UNCHANGED)}
            waiting = [name for name in order if rows[name].state is State.WAITING]
            ready = [name for name in waiting if reads[name] <= done]
            for name in ready[: AT_ONCE - len(running)]:
                running[name] = _start(name, folder, view)
                processes.append(running[name].process)
            for name, stage in running.items():
                rows[name] = replace(rows[name], state=State.RUNNING, seconds=time.monotonic() - stage.started)
            view.rows([*rows.values()], remaining_s([*rows.values()], reads))
            if not running:
                break
            time.sleep(_POLL_S)
            for name in [name for name, stage in running.items() if stage.process.poll() is not None]:
                stage = running.pop(name)
                stage.reader.join()
                status = abs(stage.process.returncode) or status
                if received:  # it was stopped
                    break
                rows[name] = _ended(rows[name], stage, outs.get(name, ()))
                if rows[name].state is State.FAILED:
                    view.rows([_stopped(row) for row in rows.values()], None)
                    view.failed(name, failure_sentence_in(stage.lines), _log_of(folder, name), stage.lines)
        if not received:  # else the signal was forwarded
            send(processes, signal.SIGTERM)
        for stage in running.values():
            stage.process.wait()
            stage.reader.join()
    taken = {row.stage: row.seconds for row in rows.values() if row.state is State.DONE and row.seconds is not None}
    write_durations(folder, durations | taken)
    done = {name for name, row in rows.items() if row.state in (State.DONE, State.UNCHANGED)}
    return 128 + received[0] if received else status, done


def _start(name: str, folder: Path, view: View) -> _Running:
    """Start a stage; what it prints goes to the view, to its log and into `lines`."""
    process = start_dvc(["--wait-for-lock", "repro", "--single-item", name], folder, stdout=PIPE, stderr=STDOUT)
    lines: list[str] = []
    log = _log_of(folder, name)
    log.parent.mkdir(parents=True, exist_ok=True)

    def forward() -> None:
        with cast(IO[bytes], process.stdout) as printed, log.open("w", encoding="utf-8") as kept:
            for line in printed:
                text = line.decode(errors="replace").rstrip("\n")
                lines.append(text)
                print(text, file=kept, flush=True)
                view.output(name, text)

    reader = threading.Thread(target=forward)
    reader.start()
    return _Running(process, reader, time.monotonic(), lines)


def _stopped(row: Row) -> Row:
    """A stage that is stopped because another one failed starts again in the next run."""
    return replace(row, state=State.WAITING, seconds=None) if row.state is State.RUNNING else row


def _ended(row: Row, stage: _Running, outs: Sequence[Path]) -> Row:
    state = ended_state(stage.process.returncode, stage.lines)
    seconds = None if state is State.UNCHANGED else time.monotonic() - stage.started
    picture = None if state is State.FAILED else newest_picture(outs)
    return replace(row, state=state, seconds=seconds, picture=picture)


def _log_of(folder: Path, name: str) -> Path:
    return folder / LOGS / f"{name}.log"
