"""Virtual robots with a journal: the same sheet, clock and tool in another process."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import load_tool
from tests.bundle.line_brush import journaled_sheet


def _path(y_m: float) -> np.ndarray:
    return timed_path(
        np.array([[0.02, y_m, -0.0005, 0], [0.05, y_m + 0.01, -0.0005, 0], [0.08, y_m, -0.0005, 0]]), 0.06
    )


def test_journal_replay_restores_sheet_clock_and_tool(tmp_path: Path) -> None:
    first = journaled_sheet(tmp_path)
    first.change_tool(load_tool("marker"))
    first.move(_path(0.03))
    first.photo()
    first.wait(2.5)
    again = journaled_sheet(tmp_path)
    assert again.clock_s == first.clock_s
    for robot in (first, again):
        robot.move(_path(0.06))
    assert np.array_equal(first.photo().frame, again.photo().frame)


def test_journal_ignores_a_truncated_last_line(tmp_path: Path) -> None:
    first = journaled_sheet(tmp_path)
    first.move(_path(0.03))
    clock_s = first.clock_s
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(journal.read_bytes() + b'["move", [[[0.0, 0.')
    again = journaled_sheet(tmp_path)
    assert again.clock_s == clock_s
    again.wait(1.0)
    assert journaled_sheet(tmp_path).clock_s == clock_s + 1.0


def test_journal_rejects_a_damaged_line(tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_text("nonsense\n")
    with pytest.raises(ContractError, match="Line 1"):
        journaled_sheet(tmp_path)
