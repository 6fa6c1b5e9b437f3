"""How the progress of `make repro` is shown: a table on a terminal, plain lines in a file, JSON for machines."""

import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from pipelines._progress import Row, State

if TYPE_CHECKING:
    from rich.console import Console
    from rich.live import Live
    from rich.table import Table

_REFRESH_S = 0.25
_TAIL = 15  # lines of a failed stage's output under the table
_FRAME = 6  # lines of the table that are no stages, and one for the prompt
_STYLES = {
    State.WAITING: "dim",
    State.RUNNING: "bold cyan",
    State.DONE: "green",
    State.UNCHANGED: "dim green",
    State.FAILED: "bold red",
}


class View(Protocol):
    """Takes in what happens. `output` is called from the threads that read the stages' output."""

    def rows(self, rows: Sequence[Row], remaining_s: float | None) -> None:
        """All stages, several times a second; `remaining_s` is the time that is left, None where unknown."""

    def output(self, stage: str, line: str) -> None:
        """A line that a stage printed, without its end."""

    def failed(self, stage: str, sentence: str, log: Path, lines: Sequence[str]) -> None:
        """A stage failed; `log` holds what it printed, `lines`."""

    def note(self, sentence: str) -> None:
        """A sentence about the whole run."""

    def end(self, status: int, report: Path | None) -> None:
        """The run is over, with an exit status and, where it is 0, the report."""


class PlainLines:
    """What stages print, each line after the stage's name."""

    def rows(self, rows: Sequence[Row], remaining_s: float | None) -> None:
        """Not shown."""

    def output(self, stage: str, line: str) -> None:
        print(f"{stage} | {line}", flush=True)

    def failed(self, stage: str, sentence: str, log: Path, lines: Sequence[str]) -> None:
        """Its lines are there already."""

    def note(self, sentence: str) -> None:
        print(sentence, flush=True)

    def end(self, status: int, report: Path | None) -> None:
        """The notes say it."""


class JsonLines:
    """One JSON object a line: `event` is stage, output, failed, note or end."""

    def __init__(self) -> None:
        self._shown: dict[str, Row] = {}

    def rows(self, rows: Sequence[Row], remaining_s: float | None) -> None:
        for row in rows:
            known = self._shown.get(row.stage)
            if known is None or known.state is not row.state:
                self._shown[row.stage] = row
                self._print(
                    "stage", stage=row.stage, state=row.state, seconds=_rounded(row.seconds),
                    expected_s=_rounded(row.expected_s), remaining_s=_rounded(remaining_s),
                    picture=None if row.picture is None else str(row.picture),
                )  # fmt: skip

    def output(self, stage: str, line: str) -> None:
        self._print("output", stage=stage, line=line)

    def failed(self, stage: str, sentence: str, log: Path, lines: Sequence[str]) -> None:
        self._print("failed", stage=stage, sentence=sentence, log=str(log))

    def note(self, sentence: str) -> None:
        self._print("note", sentence=sentence.strip())

    def end(self, status: int, report: Path | None) -> None:
        self._print("end", status=status, report=None if report is None else str(report))

    def _print(self, event: str, **values: Any) -> None:
        print(json.dumps({"event": event} | values, ensure_ascii=False), flush=True)


class LiveTable:
    """A table with one row for each stage; what stages print goes to their logs."""

    def __init__(self, live: "Live", console: "Console") -> None:
        self._live, self._console = live, console
        self._started = self._drawn = time.monotonic()
        self._last: tuple[Sequence[Row], float | None] = ((), None)

    def rows(self, rows: Sequence[Row], remaining_s: float | None) -> None:
        if not self._live.is_started:
            self._live.start()
        changed = [row.state for row in rows] != [row.state for row in self._last[0]]
        self._last = rows, remaining_s
        if changed or time.monotonic() - self._drawn >= _REFRESH_S:
            self._drawn = time.monotonic()
            self._draw(fitting(rows, self._console.height - _FRAME))

    def output(self, stage: str, line: str) -> None:
        """In the log."""

    def failed(self, stage: str, sentence: str, log: Path, lines: Sequence[str]) -> None:
        self.close()
        tail = [line for line in lines if line.strip()][-_TAIL:]
        print(*(f"{stage} | {line}" for line in tail), sep="\n")
        print(f"\n{stage} failed: {sentence}\nAll that it printed: {log}", flush=True)

    def note(self, sentence: str) -> None:
        self.close()
        print(sentence, flush=True)

    def end(self, status: int, report: Path | None) -> None:
        self.close()

    def close(self) -> None:
        """Leave the table as it is, with all its rows."""
        if self._live.is_started:
            if self._last[0]:
                self._live.vertical_overflow = "visible"
                self._draw(self._last[0])
            self._live.stop()

    def _draw(self, shown: Sequence[Row]) -> None:
        rows, remaining = self._last
        self._live.update(table_of(shown, rows, time.monotonic() - self._started, remaining), refresh=True)


def fitting(rows: Sequence[Row], height: int) -> list[Row]:
    """Return at most `height` of the rows, in their order: what fails and runs, what waits, then what was done last."""
    if len(rows) <= height:
        return [*rows]
    urgency = {State.FAILED: 0, State.RUNNING: 0, State.WAITING: 1, State.DONE: 2, State.UNCHANGED: 3}
    chosen = sorted(range(len(rows)), key=lambda index: (urgency[rows[index].state], index))[: max(height, 1)]
    return [rows[index] for index in sorted(chosen)]


def table_of(shown: Sequence[Row], rows: Sequence[Row], seconds: float, remaining_s: float | None) -> "Table":
    """Return the table of the stages `shown`; its caption tells how far all `rows` are after some seconds."""
    from rich.table import Table
    from rich.text import Text

    over = sum(row.state in (State.DONE, State.UNCHANGED) for row in rows)
    left = "" if remaining_s is None else f", about {clock(remaining_s)} left"
    hidden = f", {len(rows) - len(shown)} not shown" if len(shown) < len(rows) else ""
    caption = f"{over} of {len(rows)} stages, {clock(seconds)} so far{left}{hidden}"
    table = Table(box=None, pad_edge=False, caption=caption, caption_justify="left", header_style="bold")
    table.add_column("stage", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("time", justify="right")
    table.add_column("expected", justify="right")
    table.add_column("newest picture", overflow="fold")
    for row in shown:
        picture = Text("" if row.picture is None else str(row.picture))
        times = (clock(value) for value in (row.seconds, row.expected_s))
        table.add_row(row.stage, Text(row.state, style=_STYLES[row.state]), *times, picture)
    return table


def clock(seconds: float | None) -> str:
    """Return a duration as 7 s, 1:05 or 1:02:05; empty where it is unknown."""
    if seconds is None:
        return ""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours}:{minutes:02d}:{rest:02d}"
    return f"{minutes}:{rest:02d}" if minutes else f"{rest} s"


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 1)


@contextmanager
def opened_view(as_json: bool) -> Iterator[View]:
    """Yield the view that suits: JSON where it is wanted, the table on a terminal, else plain lines."""
    if as_json:
        yield JsonLines()
    elif not sys.stdout.isatty():
        yield PlainLines()
    else:
        from rich.console import Console
        from rich.live import Live

        console = Console()
        if console.is_dumb_terminal:
            yield PlainLines()
            return
        live = Live(console=console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False)
        table = LiveTable(live, console)
        try:
            yield table
        finally:
            table.close()
