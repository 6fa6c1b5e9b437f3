"""Collected strokes: in the contract, inside the canvas, clear of each other, the same for the same seed."""

import dataclasses
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pentimento.collection.collect import collect_strokes
from pentimento.collection.design import CollectionConfig
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table, write_table
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

PAINTS = ((0.1, 0.1, 0.1), (0.1, 0.1, 0.5))
CONFIG = CollectionConfig(6, 1, 2, 0.0, 16, 0.01, 0.008, 1000.0, (1.0, 1.0), PAINTS, 0.5, 3)


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
    other = collect("flat_brush", dataclasses.replace(CONFIG, seed=4, strokes=1, repeated=0))
    assert other[0]["path"] != rows[0]["path"]


def test_repeats_of_an_action_look_alike_and_others_do_not(rows: list[dict]) -> None:
    one, other = (row for row in rows if row["action_id"] == 4)
    assert one["path"] == other["path"] and one["window_m"] == other["window_m"]
    assert one["surface_id"] != other["surface_id"]
    assert [row["since_reload"] for row in (one, other)] == [0, 0]
    after = [decode_png(row["after"]["bytes"]).astype(int) for row in (one, other)]
    assert np.abs(after[0] - after[1]).mean() < 6
    assert all(decode_png(row["before"]["bytes"]).min() > 200 for row in (one, other))


def test_rows_say_which_load_of_which_paint(rows: list[dict]) -> None:
    for load in {row["reload_id"] for row in rows}:
        of_load = [row for row in rows if row["reload_id"] == load]
        assert [row["since_reload"] for row in of_load] == list(range(len(of_load)))
        assert len({tuple(row["color_srgb"]) for row in of_load}) == 1


def test_a_tool_too_long_for_the_canvas_is_a_sentence() -> None:
    tool = dataclasses.replace(load_tool("marker"), stroke_length_m=(0.5, 0.6))
    robot = VirtualRobot(Studio(load_world("marker"), 1))
    with pytest.raises(ContractError, match="no room"):
        collect_strokes(robot, tool, CONFIG, lambda *_: None)


def test_an_edge_that_leaves_no_canvas_is_a_sentence() -> None:
    with pytest.raises(ContractError, match="no room"):
        collect("marker", dataclasses.replace(CONFIG, edge_m=0.5))
