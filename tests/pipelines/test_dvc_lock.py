import fcntl
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from pipelines._tracking.dvc_files import locked_stages

STAGES = "schema: '2.0'\nstages:\n  paint: {cmd: paint}\n"


def test_without_a_lock_nothing_ran(tmp_path: Path) -> None:
    assert locked_stages(tmp_path) == {}


def test_a_lock_that_dvc_rewrites_is_read_whole(tmp_path: Path) -> None:
    """DVC empties the file first: who reads at that moment waits until it has written."""
    (tmp_path / ".dvc/tmp").mkdir(parents=True)
    file = tmp_path / "dvc.lock"
    file.write_text(STAGES)
    with (tmp_path / ".dvc/tmp/lock").open("w") as held, ThreadPoolExecutor() as pool:
        fcntl.flock(held, fcntl.LOCK_EX)
        file.write_text("")
        reading = pool.submit(locked_stages, tmp_path)
        with pytest.raises(TimeoutError):
            reading.result(timeout=0.2)
        file.write_text(STAGES)
        fcntl.flock(held, fcntl.LOCK_UN)
        assert reading.result(timeout=10) == {"paint": {"cmd": "paint"}}


def test_it_is_the_lock_that_dvc_takes(tmp_path: Path) -> None:
    """A DVC that would write waits for who reads."""
    subprocess.run([sys.executable, "-m", "dvc", "init", "--no-scm", "--quiet"], cwd=tmp_path, check=True)
    (tmp_path / "dvc.yaml").write_text("stages: {paint: {cmd: echo}}\n")
    run = [sys.executable, "-m", "dvc", "repro", "--force"]
    subprocess.run(run, cwd=tmp_path, capture_output=True, check=True)
    assert set(locked_stages(tmp_path)) == {"paint"}
    with (tmp_path / ".dvc/tmp/lock").open() as held:
        fcntl.flock(held, fcntl.LOCK_SH)
        refused = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert refused.returncode != 0
    assert "lock" in refused.stderr
