"""Moments are spread over the work, folders are compared byte by byte, and a process is killed when it should be."""

import sys
from itertools import chain, repeat
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import PentimentoError
from studies import kills
from studies.kills import STAGES, Ended, Killed, Stage, differing, execute, kept, kill_again_and_again, moment, verdict

WORKER = """
import pathlib, sys, time
out, done = pathlib.Path(sys.argv[1]), pathlib.Path("done")
part = pathlib.Path(f".{out}.{time.time_ns()}.tmp")
part.mkdir()
done.mkdir(exist_ok=True)
for step in range(4):
    if not (done / str(step)).exists():
        time.sleep(0.05)
        (done / str(step)).write_text("x")
(part / "all").write_text("SAYS")
part.rename(out)
for file in done.iterdir():
    file.unlink()
"""


class Counting(Stage):
    """Four steps of 50 ms, each kept, then a file."""

    def command(self, out: str) -> list[str]:
        return [sys.executable, "-c", WORKER.replace("SAYS", self.name), out]


@pytest.fixture
def counting() -> Counting:
    return Counting("counting", (), "done/*")


def test_moments_are_seeded_and_spread_over_all_of_the_work() -> None:
    drawn = [moment(np.random.default_rng(seed), 10.0) for seed in range(400)]
    assert drawn == [moment(np.random.default_rng(seed), 10.0) for seed in range(400)]
    assert 0 <= min(drawn) < 0.5 and 9.5 < max(drawn) < 10
    assert np.histogram(drawn, 4, (0, 10))[0].min() > 60


def test_folders_differ_by_what_is_missing_added_or_changed(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        (folder / "deep").mkdir(parents=True)
        (folder / "deep/same").write_bytes(b"\x00\x01")
    assert differing(one, other) == []
    (one / "gone").write_bytes(b"")
    (other / "new").write_bytes(b"")
    (other / "deep/same").write_bytes(b"\x00\x02")
    assert differing(one, other) == ["gone is missing", "new should not be there", "deep/same differs"]


def test_a_verdict_names_what_differs() -> None:
    assert "every end has the bytes" in verdict(3, []) and all(stage.name in verdict(3, []) for stage in STAGES)
    assert verdict(3, ["a differs"]) == "After 3 kills of each stage something differs: a differs."


def test_what_a_kill_left_is_told_from_an_output_that_was_complete(tmp_path: Path) -> None:
    killed = Killed(1.0, ("part-0", "part-1"))
    assert kept(killed, tmp_path / "out") == "2 to go on from, the last part-1"
    assert kept(Killed(1.0, ()), tmp_path / "out") == "nothing to go on from"
    (tmp_path / "out").mkdir()
    assert kept(Killed(1.0, ()), tmp_path / "out").endswith("its output was in place already")


def test_it_is_killed_within_its_work_and_keeps_what_it_had(
    counting: Counting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endless = "import pathlib, time; " + "; ".join(
        ["pathlib.Path('done').mkdir()", "pathlib.Path('done/0').touch()", "pathlib.Path('.out.1.tmp').mkdir()"]
    )
    with monkeypatch.context() as patched:
        patched.setattr(Counting, "command", lambda self, out: [sys.executable, "-c", f"{endless}; time.sleep(100)"])
        result = execute(counting, tmp_path, "out", 0.12)
    assert isinstance(result, Killed) and 0.12 <= result.after_s < 20 and result.kept == ("0",)
    assert not (tmp_path / "out").exists()
    assert isinstance(execute(counting, tmp_path, "out", None), Ended)
    assert (tmp_path / "out/all").read_text() == "counting"


def test_a_series_has_as_many_kills_as_wanted_and_ends_well(counting: Counting, tmp_path: Path) -> None:
    lines: list[str] = []
    assert kill_again_and_again(counting, tmp_path, 3, [1], lines.append) == []
    assert sum(": kill " in line for line in lines) == 3
    assert lines[-1] == "counting: ended after 3 kills; every byte is that of the whole run"


def test_a_difference_is_found(counting: Counting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole run says one thing, every later one another."""
    said = chain(["first"], repeat("other"))
    monkeypatch.setattr(
        Counting, "command", lambda self, out: [sys.executable, "-c", WORKER.replace("SAYS", next(said)), out]
    )
    found = kill_again_and_again(counting, tmp_path, 1, [2], lambda line: None)
    assert found and all(sentence.endswith("all differs") for sentence in found)


def test_a_stage_that_fails_by_itself_is_no_kill(tmp_path: Path) -> None:
    stage = Stage("no_such_stage", (), "done/*")
    with pytest.raises(PentimentoError, match="no_such_stage failed by itself"):
        execute(stage, tmp_path, "out", None)


def test_the_stages_are_the_pipeline_s() -> None:
    assert all((kills.ROOT / "pipelines" / f"{stage.name}.py").is_file() for stage in STAGES)
    assert all(stage.command("there")[-2:] == ["--out", "there"] for stage in STAGES)
