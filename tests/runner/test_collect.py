"""Collected strokes: in the contract, inside the canvas, clear of each other, the same for the same seed."""

import dataclasses
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table, write_table
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.runner.collect import CollectionConfig, collect_strokes
from pentimento.runner.safety import GuardedRobot, envelope_for
from pentimento.studio.studio import Studio
from pentimento.studio.world import load_world

CONFIG = CollectionConfig(6, 16, 0.01, 0.008, 1000.0, 1.0, ((0.1, 0.1, 0.1), (0.1, 0.1, 0.5)), 0.5, 3)


def collect(tool_name: str, config: CollectionConfig = CONFIG) -> list[dict]:
    tool = load_tool(tool_name)
    robot = VirtualRobot(Studio(load_world(tool_name), 1))
    return collect_strokes(GuardedRobot(robot, envelope_for(tool, robot.canvas_size_m)), tool, config, lambda *_: None)


@pytest.fixture(scope="module")
def rows() -> list[dict]:
    return collect("flat_brush")


def test_rows_keep_the_contract(rows: list[dict], tmp_path: Path) -> None:
    table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))
    write_table(tmp_path / "strokes", table, CONTRACT, "# Card")
    checked = read_table(tmp_path / "strokes", CONTRACT)
    assert checked.table.num_rows == CONFIG.strokes
    assert checked.quarantined == ()


def test_every_stroke_leaves_its_mark_on_its_path(rows: list[dict]) -> None:
    for row in rows:
        before, after = (decode_png(row[name]["bytes"]).astype(int) for name in ("before", "after"))
        x_min, _, _, y_max = row["window_m"]
        path = np.array(row["path"])
        column = ((path[:, 1] - x_min) * CONFIG.pixels_per_m).astype(int)
        line = ((y_max - path[:, 2]) * CONFIG.pixels_per_m).astype(int)
        darker = (before - after).sum(-1)
        assert darker[line, column].mean() > 100
        assert np.abs(darker[:3]).mean() < 15  # paper at the window's upper edge


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(rows: list[dict]) -> None:
    assert repr(collect("flat_brush")) == repr(rows)  # NaN is not equal to itself
    other = collect("flat_brush", dataclasses.replace(CONFIG, seed=4, strokes=1))
    assert other[0]["path"] != rows[0]["path"]


def test_brushes_dip_by_the_tool_file_and_keep_a_colour_for_each_dip(rows: list[dict]) -> None:
    assert [row["since_reload"] for row in rows] == [0, 1, 2, 3, 0, 1]
    assert len({tuple(row["color_srgb"]) for row in rows[:4]}) == 1


def test_a_tool_too_long_for_the_canvas_is_a_sentence() -> None:
    tool = dataclasses.replace(load_tool("marker"), stroke_length_m=(0.5, 0.6))
    robot = VirtualRobot(Studio(load_world("marker"), 1))
    with pytest.raises(ContractError, match="no room"):
        collect_strokes(robot, tool, CONFIG, lambda *_: None)


def test_an_edge_that_leaves_no_canvas_is_a_sentence() -> None:
    with pytest.raises(ContractError, match="no room"):
        collect("marker", dataclasses.replace(CONFIG, edge_m=0.5))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("strokes", 0), ("path_points", 1), ("margin_m", 0.0), ("edge_m", -0.1), ("pixels_per_m", 0.0),
        ("settle_s", -1.0), ("yaw_spread_rad", -1.0), ("seed", -1), ("palette_srgb", ()),
        ("palette_srgb", ((2.0, 0.0, 0.0),)),
    ],
)  # fmt: skip
def test_numbers_out_of_their_ranges_are_named(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=rf"^{field} "):
        dataclasses.replace(CONFIG, **{field: value})
