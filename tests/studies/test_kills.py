"""Killing stages: partial outputs, different bytes and leftover files are found."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import PentimentoError
from studies.kills import Stage, differing, execute, kill_repeatedly, split_evenly, stages_of

ATOMIC = """
import pathlib, shutil, time
for old in pathlib.Path().glob(".out.*.tmp"):
    shutil.rmtree(old)
part = pathlib.Path(f".out.{time.time_ns()}.tmp")
part.mkdir()
for number in range(4):
    (part / str(number)).write_text("x")
    time.sleep(0.05)
part.rename("out")
"""
NOT_ATOMIC = ATOMIC.replace("part.rename", "pathlib.Path().joinpath").replace('f".out.{time.time_ns()}.tmp"', '"out"')
LEAVES_TEMPORARY = ATOMIC.replace("shutil.rmtree(old)", "pass")
NOT_REPRODUCIBLE = ATOMIC.replace('write_text("x")', "write_text(str(time.time()))")


@pytest.fixture
def pipeline(tmp_path: Path) -> Path:
    """A pipeline with a complete output."""
    out = tmp_path / "pipeline/out"
    out.mkdir(parents=True)
    for number in range(4):
        (out / str(number)).write_text("x")
    return out.parent


def found(code: str, pipeline: Path) -> str:
    folder = pipeline.with_name("folder")
    folder.mkdir()
    stage = Stage("stage", ("python", "-S", "-c", code), ("out",))
    return "; ".join(kill_repeatedly(stage, pipeline, folder, 6, np.random.default_rng(0))[0])


def test_atomic_stage_has_no_differences(pipeline: Path) -> None:
    assert found(ATOMIC, pipeline) == ""


def test_partial_output_is_found(pipeline: Path) -> None:
    result = found(NOT_ATOMIC, pipeline)
    assert "after kill" in result and "is missing" in result and "in the end" not in result


def test_bytes_that_change_between_runs_are_found_without_a_kill(pipeline: Path) -> None:
    assert found(NOT_REPRODUCIBLE, pipeline).startswith("without interruption, out: 0 differs")


def test_leftover_temporary_folder_is_found(pipeline: Path) -> None:
    assert "is left over" in found(LEAVES_TEMPORARY, pipeline)


def test_stage_that_fails_without_being_killed_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(PentimentoError, match=r"stage failed without being killed \(1\): .*broken"):
        execute(Stage("stage", ("python", "-S", "-c", "raise SystemExit('broken')"), ("out",)), tmp_path, None)


def test_stages_are_read_from_dvc_lock_and_can_be_chosen() -> None:
    lock = {"stages": {"a@b": {"cmd": "python -m pipelines.a --out 'data/a b'", "outs": [{"path": "data/a b"}]}}}
    assert stages_of(lock) == [Stage("a@b", ("python", "-m", "pipelines.a", "--out", "data/a b"), ("data/a b",))]
    assert stages_of(lock, ["a@b"]) == stages_of(lock)
    with pytest.raises(PentimentoError, match="has no stage c; it has a@b"):
        stages_of(lock, ["c"])


def test_kills_are_split_evenly() -> None:
    assert split_evenly(200, 28) == [8] * 4 + [7] * 24


def test_folders_differ_by_missing_additional_and_changed_files(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        (folder / "deep").mkdir(parents=True)
        (folder / "deep/same").write_bytes(b"\x00\x01")
    assert differing(one, other) == []
    (one / "gone").write_bytes(b"")
    (other / "new").write_bytes(b"")
    (other / "deep/same").write_bytes(b"\x00\x02")
    assert differing(one, other) == ["gone is missing", "new is not in the original", "deep/same differs"]
