"""Displaced paths find their ink again."""

from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.cli.main import main
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.dynamics.strokes.registration import Registered, register
from tests.dynamics.strokes.conftest import stroke_row, table

WHITE = np.full((160, 240, 3), 255, np.uint8)  # 4 px/mm
WINDOW_M = (0.01, 0.02, 0.07, 0.06)


def written(displaced_m: np.ndarray, seed: int = 0) -> pa.Table:
    """Curved strokes 0.75 mm wide, whose recorded paths are displaced by these [B, 2]."""
    rng = np.random.default_rng(seed)
    rows = []
    for number, away_m in enumerate(displaced_m):
        angle = np.linspace(0, rng.uniform(2, 5), 60) + rng.uniform(0, 6)
        x_m = rng.uniform(0.03, 0.05) + 0.006 * np.cos(angle)
        y_m = rng.uniform(0.035, 0.045) + 0.004 * np.sin(angle)
        column, row = (x_m - WINDOW_M[0]) * 4000 - 0.5, (WINDOW_M[3] - y_m) * 4000 - 0.5
        image = WHITE.copy()
        points = np.round(np.stack([column, row], axis=1) * 16).astype(np.int32)
        cv2.polylines(image, [points], False, (40, 40, 60), 3, cv2.LINE_AA, 4)
        path = np.stack([np.arange(60.0), x_m + away_m[0], y_m + away_m[1], np.full(60, -1e-3), np.zeros(60)], axis=1)
        rows.append(stroke_row(path, WHITE, image, number) | {"window_m": list(WINDOW_M)})
    return table(rows)


def test_each_path_moves_onto_its_own_ink() -> None:
    """Within half a pixel (0.125 mm), from displacements of up to 0.7 mm."""
    away_m = np.random.default_rng(1).uniform(-5e-4, 5e-4, (12, 2))
    registered = register(written(away_m))
    np.testing.assert_allclose(registered.moved_m, -away_m, atol=1.25e-4)
    before, after = (
        np.array([np.array(path)[0, 1:3] for path in each["path"].to_pylist()])
        for each in (written(0 * away_m), registered.table)
    )
    np.testing.assert_allclose(after, before, atol=1.25e-4)


def test_a_path_far_from_any_ink_stays() -> None:
    away_m = np.zeros((6, 2))
    away_m[2] = 0.006, 0.0
    strokes = written(away_m)
    registered = register(strokes)
    assert np.isnan(registered.moved_m).any(1).tolist() == [False, False, True, False, False, False]
    assert registered.table["path"][2] == strokes["path"][2]
    assert "1 of 6 lie farther from any ink and stayed" in registered.sentence


def test_a_table_without_any_path_near_its_ink_is_told() -> None:
    assert "check the frame" in Registered(written(np.zeros((3, 2))), np.full((3, 2), np.nan)).sentence


def test_registered_strokes_can_be_registered_again_without_moving() -> None:
    once = register(written(np.random.default_rng(2).uniform(-3e-4, 3e-4, (6, 2))))
    assert np.abs(register(once.table).moved_m).max() <= 1.25e-4  # a step is 1/16 mm


def test_the_command_writes_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pq.write_table(written(np.full((6, 2), 3e-4)), tmp_path / "rows.parquet")
    assert main(["register", str(tmp_path / "rows.parquet"), "--out", str(tmp_path / "registered")]) == 0
    said = capsys.readouterr().out
    assert "moved onto its ink: 0.4" in said
    assert read_table(tmp_path / "registered", CONTRACT).table.num_rows == 6
    assert said.strip() in (tmp_path / "registered" / "README.md").read_text()
