"""The progress of `make repro`: states and forecasts, the table, and the lines for machines."""

import json
import os
from pathlib import Path

import pytest

from pipelines._progress import (
    LOGS,
    Row,
    State,
    ended_state,
    failure_sentence_in,
    newest_picture,
    read_durations,
    remaining_s,
    write_durations,
)
from pipelines._progress_views import JsonLines, PlainLines, clock, fitting, opened_view, table_of
from pipelines._repro import open_report
from pipelines._side_by_side import bring_up_to_date

WAITING, RUNNING, DONE, UNCHANGED, FAILED = State


def test_what_is_left_follows_the_two_places_and_what_stages_read() -> None:
    """a (4 s left) and b (3 s) run; c reads b and starts at 3, d reads a and starts at 4, e gets a place at 5 only."""
    rows = [
        Row("a", RUNNING, 6.0, 10.0),
        Row("b", RUNNING, 1.0, 4.0),
        Row("c", WAITING, None, 2.0),
        Row("d", WAITING, None, 5.0),
        Row("e", WAITING, None, 1.5),
        Row("f", DONE, 3.0, 3.0),
        Row("g", UNCHANGED),
    ]
    reads = {"a": set(), "b": set(), "c": {"b"}, "d": {"a"}, "e": {"b"}, "f": set()}
    frozen = {name: frozenset(read) for name, read in reads.items()}
    assert remaining_s(rows, frozen) == pytest.approx(9.0)
    assert remaining_s(rows[:1], frozen) == pytest.approx(4.0)
    assert remaining_s(rows[5:], frozen) == 0.0
    late = [Row("a", RUNNING, 60.0, 10.0)]
    assert remaining_s(late, frozen) == 0.0, "a stage that is late ends at any moment"
    assert remaining_s([*rows, Row("new", WAITING)], frozen | {"new": frozenset()}) is None


def test_durations_are_kept_and_a_damaged_file_only_costs_the_forecast(tmp_path: Path) -> None:
    assert read_durations(tmp_path) == {}
    write_durations(tmp_path, {"paint@colour": 12.34})
    assert read_durations(tmp_path) == {"paint@colour": 12.3}
    (tmp_path / ".pentimento/durations.json").write_text("[1")
    assert read_durations(tmp_path) == {}


def test_dvcs_lines_tell_whether_a_stage_ran() -> None:
    assert ended_state(0, ["Running stage 'one':", "> echo", "all didn't change, skipping"]) is DONE
    assert ended_state(0, ["Stage 'one' didn't change, skipping"]) is UNCHANGED
    assert ended_state(0, ["Stage 'one' is cached - skipping run, checking out outputs"]) is UNCHANGED
    assert ended_state(1, ["Stage 'one' didn't change, skipping"]) is FAILED


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (
            ["Running stage 'paint':", "> python -m pipelines.paint", "paint: no sheet; lay one.", "ERROR: failed", ""],
            "paint: no sheet; lay one.",
        ),
        (["Running stage 'paint':", "> python", "ERROR: failed to run: python, exited with -9"],
         "ERROR: failed to run: python, exited with -9"),
        ([], "It ended without a word."),
    ],
)  # fmt: skip
def test_the_sentence_of_a_failure_is_the_stages_own(lines: list[str], sentence: str) -> None:
    assert failure_sentence_in(lines) == sentence


def test_the_newest_picture_is_looked_for_at_the_top_of_the_outputs(tmp_path: Path) -> None:
    for number, name in enumerate(("out/a.png", "out/b.png", "out/frames/c.png", "other/frames/d.png")):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
        os.utime(tmp_path / name, (number, number))
    out, other = tmp_path / "out", tmp_path / "other"
    assert newest_picture([out, tmp_path / "gone"]) == out / "b.png"
    assert newest_picture([other]) == other / "frames/d.png"
    assert newest_picture([]) is None


def test_the_table_shows_every_state() -> None:
    from rich.console import Console

    rows = [
        Row("one", DONE, 65.2, 61.0, Path("data/one.png")),
        Row("two", RUNNING, 3.0, 9.0),
        Row("three", WAITING, None, 4.0),
        Row("four", UNCHANGED),
        Row("five", FAILED, 1.0),
    ]
    console = Console(width=100, no_color=True)
    with console.capture() as shown:
        console.print(table_of(rows, rows, 68.0, 10.4))
    lines = shown.get().splitlines()
    assert lines[1].split() == ["one", "done", "1:05", "1:01", "data/one.png"]
    assert lines[2].split() == ["two", "running", "3", "s", "9", "s"]
    assert lines[3].split() == ["three", "waiting", "4", "s"]
    assert lines[4].split() == ["four", "unchanged"] and lines[5].split() == ["five", "failed", "1", "s"]
    assert lines[6].strip() == "2 of 5 stages, 1:08 so far, about 10 s left"


def test_a_low_terminal_shows_what_runs_first() -> None:
    states = {"old": UNCHANGED, "done": DONE, "wrong": FAILED, "runs": RUNNING, "next": WAITING, "last": WAITING}
    rows = [Row(name, state) for name, state in states.items()]
    assert [row.stage for row in fitting(rows, 6)] == [*states]
    assert [row.stage for row in fitting(rows, 3)] == ["wrong", "runs", "next"]
    assert [row.stage for row in fitting(rows, -4)] == ["wrong"]
    assert [clock(value) for value in (None, 6.6, 65, 3725)] == ["", "7 s", "1:05", "1:02:05"]


def test_where_stdout_is_no_terminal_lines_are_plain() -> None:
    with opened_view(as_json=False) as view:
        assert isinstance(view, PlainLines)


STAGES = """stages:
  one: {cmd: echo painted && mkdir out && touch out/a.png, outs: [out]}
  two: {cmd: "ls out && echo 'two: no sheet; lay one.' && exit 3", deps: [out], outs: [never]}
  aside: {cmd: echo beside > aside, outs: [aside]}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / ".dvc").mkdir()
    (tmp_path / ".dvc/config").write_text(
        "[core]\n    no_scm = true\n    analytics = false\n    check_update = false\n"
    )
    (tmp_path / "dvc.yaml").write_text(STAGES)
    return tmp_path


def test_machines_read_every_change_of_state_and_why_a_stage_failed(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert bring_up_to_date(folder, JsonLines()).status != 0
    events = [json.loads(line) for line in capfd.readouterr().out.splitlines()]
    states = [(each["stage"], each["state"]) for each in events if each["event"] == "stage"]
    assert states[:3] == [("one", "running"), ("aside", "running"), ("two", "waiting")]
    assert states.index(("one", "done")) < states.index(("two", "running")) < states.index(("two", "failed"))
    assert ("aside", "done") in states
    (done,) = (each for each in events if each.get("stage") == "one" and each.get("state") == "done")
    assert done["picture"] == str(folder / "out/a.png") and done["seconds"] > 0
    assert {"event": "output", "stage": "one", "line": "painted"} in events
    (failed,) = (each for each in events if each["event"] == "failed")
    assert failed["stage"] == "two" and failed["sentence"] == "two: no sheet; lay one."
    assert "two: no sheet; lay one." in Path(failed["log"]).read_text(encoding="utf-8")
    assert (folder / LOGS / "one.log").is_file()
    assert set(read_durations(folder)) == {"one", "aside"}


def test_what_is_up_to_date_is_unchanged(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    first, second = "stages:\n  one: {cmd: touch out, outs: [out]}\n", "  two: {cmd: touch late, outs: [late]}\n"
    (folder / "dvc.yaml").write_text(first)
    assert bring_up_to_date(folder, PlainLines()).status == 0
    (folder / "dvc.yaml").write_text(first + second)
    capfd.readouterr()
    assert bring_up_to_date(folder, JsonLines()).status == 0
    events = [json.loads(line) for line in capfd.readouterr().out.splitlines()]
    states = [(each["stage"], each["state"]) for each in events if each["event"] == "stage"]
    assert states == [("two", "running"), ("one", "unchanged"), ("two", "done")]
    assert bring_up_to_date(folder, JsonLines()).status == 0
    assert json.loads(capfd.readouterr().out) == {"event": "note", "sentence": "Data and pipelines are up to date."}


def test_the_report_opens_only_beside_a_terminal_with_a_window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    class Browser:
        def open(self, address: str) -> None:
            opened.append(address)

    page = tmp_path / "index.html"
    monkeypatch.setattr("webbrowser.get", Browser)
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("sys.stdout.isatty", lambda: False, raising=False)
    open_report(page)
    assert opened == []
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("CI", "true")
    open_report(page)
    assert opened == []
    monkeypatch.delenv("CI")
    open_report(page)
    assert opened == [page.as_uri()]
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    open_report(page)
    assert len(opened) == 1
