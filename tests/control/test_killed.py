"""A painting whose process is killed at random moments is finished by resuming it."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.checkpoint import load_state
from pentimento.control.session import RECORD
from pipelines._imports import ROOT
from tests.bundle.line_brush import journaled_sheet
from tests.control.paintings import STROKES, error_of, finished


@pytest.mark.timeout(300)
def test_killed_three_times_and_finished(tmp_path: Path) -> None:
    chance = random.Random(4)
    for kill_after in (2, 5, 8):
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.control.painting_process", str(tmp_path)],
            cwd=ROOT, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        )  # fmt: skip
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) >= kill_after:
                break
        time.sleep(chance.uniform(0, 0.15))  # anywhere in the strokes that follow
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        process.stdout.close()
    before = load_state(tmp_path)
    assert 8 <= before.executed < STROKES
    done = finished(journaled_sheet(tmp_path), tmp_path)
    assert done.sessions == 4 and len(done.remaining) == 0 and error_of(done, tmp_path) < 0.65
    recorded = read_table(tmp_path / RECORD, CONTRACT)
    assert not recorded.quarantined and done.executed - 3 <= recorded.table.num_rows <= done.executed
