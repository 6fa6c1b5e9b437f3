"""A rehearsal says beforehand what the recording will say, as far as commands alone decide it."""

from pathlib import Path

import numpy as np
import pytest

from pentimento.collection.collect import collect_strokes
from pentimento.collection.design import CollectionConfig, design_collection
from pentimento.collection.rehearse import rehearse
from pentimento.contracts.images import decode_png
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table, write_table
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

PAINTS = ((0.1, 0.1, 0.1), (0.1, 0.1, 0.5))
CONFIG = CollectionConfig(9, 1, 2, 0.7, 16, 0.01, 0.008, 1000.0, (1.0, 9.0), PAINTS, 0.5, 3)
TOOL = load_tool("round_brush")
CANVAS_M = (0.3, 0.2)


@pytest.fixture(scope="module")
def rehearsed() -> list[dict]:
    return rehearse(design_collection(TOOL, CANVAS_M, np.array(PAINTS), CONFIG), TOOL, CANVAS_M, CONFIG).to_pylist()


def test_what_follows_from_commands_is_as_it_will_be_recorded(rehearsed: list[dict]) -> None:
    robot = VirtualRobot(Studio(load_world("round_brush"), 1))
    guarded = GuardedRobot(robot, envelope_for(TOOL, robot.canvas_size_m))
    recorded = collect_strokes(guarded, TOOL, CONFIG, lambda *_: None)
    same = ("session", "order", "action_id", "tool", "since_reload", "reload_id", "surface_id")
    near = ("path", "window_m", "color_srgb", "ink_since_reload_m", "tool_age_m", "previous_color_srgb")
    for one, other in zip(rehearsed, recorded, strict=True):
        assert {name: one[name] for name in same} == {name: other[name] for name in same}
        for name in near:
            np.testing.assert_allclose(one[name], other[name], atol=1e-6)
        assert np.isnan(one["wet_age_s"]) == np.isnan(other["wet_age_s"])
        # Minutes pass, and neither robot nor rehearsal is many times faster.
        assert other["t_start_s"] / 2 < one["t_start_s"] < other["t_start_s"] * 2


def test_rows_keep_the_contract(rehearsed: list[dict], tmp_path: Path) -> None:
    table = rehearse(design_collection(TOOL, CANVAS_M, np.array(PAINTS), CONFIG), TOOL, CANVAS_M, CONFIG)
    write_table(tmp_path / "strokes", table, CONTRACT, "# Card")
    checked = read_table(tmp_path / "strokes", CONTRACT)
    assert checked.table.num_rows == CONFIG.strokes and checked.quarantined == ()


def test_each_stroke_is_drawn_where_it_is_commanded_and_wider_where_it_presses_deeper(rehearsed: list[dict]) -> None:
    area, length, press = [], [], []
    for row in rehearsed:
        before, after = (decode_png(row[name]["bytes"]).astype(int) for name in ("before", "after"))
        path = np.array(row["path"])
        x_min, _, _, y_max = row["window_m"]
        column, line = ((path[:, 1] - x_min) * 1000).astype(int), ((y_max - path[:, 2]) * 1000).astype(int)
        assert np.abs(after[line, column] - 255 * np.array(row["color_srgb"])).max() < 60
        if np.isnan(row["wet_age_s"]):
            area.append((np.abs(after - before).max(-1) > 100).sum() / 1e6)
            length.append(np.hypot(*np.diff(path[:, 1:3], axis=0).T).sum())
            press.append(-path[:, 3].mean())
    width = (np.array(area) - np.pi / 4 * TOOL.nominal_width_m**2) / np.array(length)
    assert 0.5 * TOOL.nominal_width_m < width.min() < width.max() < 1.6 * TOOL.nominal_width_m
    assert np.corrcoef(width, press)[0, 1] > 0.7


def test_a_stroke_over_paint_finds_it_and_a_new_sheet_is_blank(rehearsed: list[dict]) -> None:
    blank = [decode_png(row["before"]["bytes"]).min() > 200 for row in rehearsed]
    crossed = [not np.isnan(row["wet_age_s"]) for row in rehearsed]
    assert any(crossed) and not all(crossed)
    assert not any(clean and over for clean, over in zip(blank, crossed, strict=True))
