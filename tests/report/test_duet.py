"""The report's section on a sheet that was drawn in turns."""

import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.report.duet import duet_section, read_duet
from pentimento.report.html import Album

TURN = {"asked": "a sun", "strokes": {"person": 4, "robot": 9}, "error": {"no_change": 0.0219, "drawn": 0.00198}}


def write(folder: Path) -> Path:
    """A sheet of one turn as the stage `duet` writes it."""
    folder.mkdir()
    for name in ("turns", "sheet"):
        write_png(folder / f"{name}.png", np.full((40, 60, 3), 200, np.uint8))
    (folder / "metrics.json").write_text(json.dumps({"tool": "round_brush", "turns": [TURN]}))
    return folder


def test_section_shows_each_turn_with_its_errors(tmp_path: Path) -> None:
    album = Album()
    html = duet_section(read_duet(write(tmp_path / "duet")), album)
    for text in ("round brush", "1: “a sun”", ">4<", ">9<", "0.0219", "0.00198"):
        assert text in html
    assert set(album.files) == {"duet_sheet.png", "duet_turns.png"}


def test_a_missing_entry_names_the_stage(tmp_path: Path) -> None:
    folder = write(tmp_path / "duet")
    (folder / "metrics.json").write_text(json.dumps({"tool": "pen", "turns": [{"asked": "a sun"}]}))
    with pytest.raises(ContractError, match="duet"):
        read_duet(folder)
