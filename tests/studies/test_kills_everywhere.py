"""A stage that writes half an output, other bytes or leaves something behind is found; a careful one is not."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import PentimentoError
from studies.kills_everywhere import Stage, execute, kill_again_and_again, shares, stages_of

CAREFUL = """
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
CARELESS = CAREFUL.replace("part.rename", "pathlib.Path().joinpath").replace('f".out.{time.time_ns()}.tmp"', '"out"')
FORGETFUL = CAREFUL.replace("shutil.rmtree(old)", "pass")
WAYWARD = CAREFUL.replace('write_text("x")', "write_text(str(time.time()))")


@pytest.fixture
def pipeline(tmp_path: Path) -> Path:
    """Where each output stands as it should be."""
    out = tmp_path / "pipeline/out"
    out.mkdir(parents=True)
    for number in range(4):
        (out / str(number)).write_text("x")
    return out.parent


def found(code: str, pipeline: Path) -> str:
    folder = pipeline.with_name("folder")
    folder.mkdir()
    stage = Stage("stage", ("python", "-S", "-c", code), ("out",))
    return "; ".join(kill_again_and_again(stage, pipeline, folder, 6, np.random.default_rng(0))[0])


def test_a_stage_whose_output_is_there_or_not_has_no_difference(pipeline: Path) -> None:
    assert found(CAREFUL, pipeline) == ""


def test_an_output_that_is_half_there_is_found(pipeline: Path) -> None:
    said = found(CARELESS, pipeline)
    assert "after kill" in said and "is missing" in said and "in the end" not in said


def test_bytes_that_change_from_run_to_run_are_found_in_peace(pipeline: Path) -> None:
    assert found(WAYWARD, pipeline).startswith("in peace, out: 0 differs")


def test_what_is_left_beside_the_output_is_found(pipeline: Path) -> None:
    assert "is left over" in found(FORGETFUL, pipeline)


def test_a_stage_that_fails_by_itself_is_no_kill(tmp_path: Path) -> None:
    with pytest.raises(PentimentoError, match=r"stage failed by itself \(1\): .*no such luck"):
        execute(Stage("stage", ("python", "-S", "-c", "raise SystemExit('no such luck')"), ("out",)), tmp_path, None)


def test_stages_are_those_of_the_lock_file() -> None:
    lock = {"stages": {"a@b": {"cmd": "python -m pipelines.a --out 'data/a b'", "outs": [{"path": "data/a b"}]}}}
    assert stages_of(lock) == [Stage("a@b", ("python", "-m", "pipelines.a", "--out", "data/a b"), ("data/a b",))]


def test_kills_are_spread_evenly() -> None:
    assert shares(200, 28) == [8] * 4 + [7] * 24
