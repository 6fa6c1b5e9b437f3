"""Two stages at a time, on a little pipeline that DVC itself runs."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pentimento.contracts.errors import PentimentoError
from pipelines._progress_views import PlainLines
from pipelines._side_by_side import bring_up_to_date, in_order, items_of, needed_by, out_of_date

DOT = """strict digraph {
"scenes";
"scenes" -> "semantics";
"semantics" -> "deploy";
"strokes@marker" -> "deploy";
"strokes@marker" -> "report";
"hands";
}"""


def test_what_reads_from_a_changed_stage_must_be_looked_at() -> None:
    assert out_of_date({"semantics": ["changed deps"]}, DOT) == {
        "semantics": frozenset(),
        "deploy": frozenset({"semantics"}),
    }
    assert out_of_date({"strokes@marker": [], "hands": []}, DOT) == {
        "strokes@marker": frozenset(),
        "deploy": frozenset({"strokes@marker"}),
        "report": frozenset({"strokes@marker"}),
        "hands": frozenset(),
    }
    assert out_of_date({}, DOT) == {}
    assert out_of_date({"base/dvc.yaml:train": []}, DOT) == {}  # another pipeline's


def test_the_longest_chain_comes_first() -> None:
    everything = out_of_date({"hands": [], "strokes@marker": [], "scenes": []}, DOT)
    assert in_order(everything) == ["scenes", "semantics", "strokes@marker", "deploy", "hands", "report"]


def test_a_stage_needs_what_it_reads_and_no_more() -> None:
    assert needed_by(["semantics"], DOT) == {"scenes", "semantics"}
    assert needed_by(["deploy", "hands"], DOT) == {"scenes", "semantics", "strokes@marker", "deploy", "hands"}


MEETING = """
import pathlib, sys, time
mine, other = map(pathlib.Path, sys.argv[1:])
mine.write_text("here")
until = time.monotonic() + 30
while not other.exists():
    assert time.monotonic() < until, "the other one never came"
    time.sleep(0.05)
"""


def pipeline(folder: Path, *stages: str) -> Path:
    (folder / ".dvc").mkdir()
    (folder / ".dvc/config").write_text("[core]\n    no_scm = true\n    analytics = false\n    check_update = false\n")
    (folder / "meet.py").write_text(MEETING)
    (folder / "dvc.yaml").write_text("\n".join(["stages:", *stages]))
    return folder


def test_independent_stages_run_at_once_and_readers_after_them(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """`one` and `two` each wait for a sign of the other: one after the other they would never end."""
    folder = pipeline(
        tmp_path,
        "  one: {cmd: python meet.py sign1 sign2 && echo 1 > first, outs: [first]}",
        "  two: {cmd: python meet.py sign2 sign1 && echo 2 > second, outs: [second]}",
        "  both: {cmd: cat first second > sum && echo added, deps: [first, second], outs: [sum]}",
    )
    assert bring_up_to_date(folder, PlainLines()).status == 0
    assert (folder / "sum").read_text() == "1\n2\n"
    said = capfd.readouterr().out
    assert "both | added\n" in said
    assert said.index("one | ") < said.index("both | ")
    assert bring_up_to_date(folder, PlainLines()).status == 0
    again = capfd.readouterr().out
    assert " | " not in again, "nothing is out of date, no stage is looked at twice"
    assert "up to date" in again


def test_one_stage_runs_with_what_it_reads_and_the_rest_stays_out_of_date(tmp_path: Path) -> None:
    folder = pipeline(
        tmp_path,
        "  one: {cmd: echo 1 > first, outs: [first]}",
        "  each: {matrix: {tool: [brush, marker]}, cmd: 'cat first > ${item.tool}', deps: [first], "
        "outs: ['${item.tool}']}",
        "  last: {cmd: cat marker > end, deps: [marker], outs: [end]}",
    )
    assert items_of("each", folder) == ["each@brush", "each@marker"]
    for unknown, known in (("each@markr", "each@brush, each@marker"), ("onne", "one")):
        with pytest.raises(PentimentoError, match=f"no stage '{unknown}' in .*; there is {known}.$"):
            items_of(unknown, folder)
    assert bring_up_to_date(folder, PlainLines(), ["each@marker"]) == (0, {"each@brush", "last"})
    assert sorted(name for name in ("first", "brush", "marker", "end") if (folder / name).exists()) == [
        "first",
        "marker",
    ]


def test_a_failure_stops_the_other_stage_and_is_the_status(tmp_path: Path) -> None:
    folder = pipeline(
        tmp_path,
        "  wrong: {cmd: python meet.py sign1 sign2 && exit 3, outs: [first]}",
        "  long: {cmd: python meet.py sign2 sign1 && sleep 300, outs: [second]}",
        "  after: {cmd: touch reached, deps: [first], outs: [reached]}",
    )
    started = time.monotonic()
    assert bring_up_to_date(folder, PlainLines()).status != 0
    assert time.monotonic() - started < 60
    assert not (folder / "reached").exists()


def test_a_terminated_run_ends_its_stages(tmp_path: Path) -> None:
    folder = pipeline(tmp_path, "  long: {cmd: echo $$ > began && exec sleep 300, outs: [first]}")
    code = (
        "import sys; from pathlib import Path; from pipelines._progress_views import PlainLines\n"
        "from pipelines._side_by_side import bring_up_to_date\n"
        "sys.exit(bring_up_to_date(Path(sys.argv[1]), PlainLines()).status)"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(folder)])
    until = time.monotonic() + 60
    while not ((folder / "began").exists() and (folder / "began").read_text().strip()):
        assert time.monotonic() < until
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    assert process.wait(30) == 143
    sleeping = int((folder / "began").read_text())
    until = time.monotonic() + 10
    while Path(f"/proc/{sleeping}").exists():
        assert time.monotonic() < until, "the stage outlived the run"
        time.sleep(0.05)


def test_a_pipeline_that_dvc_cannot_read_is_dvcs_to_explain(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = pipeline(tmp_path, "  one: {comand: x}")
    assert bring_up_to_date(folder, PlainLines()).status != 0
    assert "dvc.yaml" in capfd.readouterr().err
