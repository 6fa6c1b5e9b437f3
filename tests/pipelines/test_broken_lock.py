import subprocess
import sys
from pathlib import Path

import pytest

from pipelines._dvc import put_aside_broken_lock

PIPELINE = """stages:
  collect: {cmd: mkdir -p strokes && echo ran >> log && cp told strokes/table, deps: [told], outs: [strokes]}
  train: {cmd: mkdir -p model && echo ran >> log && cp strokes/table model/weights, deps: [strokes], outs: [model]}
"""


def dvc(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dvc", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pipeline")
    assert dvc(folder, "init", "--no-scm", "--quiet").returncode == 0
    (folder / "dvc.yaml").write_text(PIPELINE)
    (folder / "told").write_text("a brush\n")
    assert dvc(folder, "repro").returncode == 0
    return folder


def test_a_whole_lock_stays(pipeline: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (pipeline / "dvc.lock").read_bytes()
    put_aside_broken_lock(pipeline)
    assert (pipeline / "dvc.lock").read_bytes() == before
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("last", [b"", b"schema: '2", b"collect:"])
def test_what_a_lock_that_was_cut_off_knew_is_found_again(
    pipeline: Path, last: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    """DVC itself refuses such a file; nothing runs again."""
    lock = pipeline / "dvc.lock"
    whole = lock.read_bytes()
    lock.write_bytes(whole[: whole.index(last) + len(last)])
    assert dvc(pipeline, "repro").returncode != 0
    put_aside_broken_lock(pipeline)
    assert "dvc.lock cannot be read" in capsys.readouterr().err
    assert dvc(pipeline, "repro").returncode == 0
    assert lock.read_bytes() == whole
    assert (pipeline / "log").read_text() == "ran\nran\n"


def test_where_no_dvc_ran_nothing_is_touched(tmp_path: Path) -> None:
    (tmp_path / "dvc.lock").write_text("")
    put_aside_broken_lock(tmp_path)
    assert (tmp_path / "dvc.lock").is_file()
