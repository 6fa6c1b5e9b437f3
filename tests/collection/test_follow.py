"""Proposed strokes become rows that a table goes on with."""

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pentimento.collection.follow import follow, tool_of
from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.images import decode_png
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import read_table, write_table
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.motion import timed_path
from pentimento.robots.strokes import stroke_points
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

TOOL = load_tool("round_brush")
INK, RED = [0.1, 0.1, 0.1], [0.5, 0.1, 0.1]


def actions(*changes: dict[str, Any]) -> pa.Table:
    """As `next_actions.parquet`: strokes beside one another, with changes to each."""
    rows = []
    for number, change in enumerate(changes):
        points = stroke_points(
            np.array([0.06 + 0.07 * number, 0.1]),
            0.3,
            0.035,
            bend_m=0.004,
            press_m=np.full(3, 0.002),
            yaw_rad=0.0,
            points=16,
        )
        x, y = points[:, 0], points[:, 1]
        window = [x.min() - 0.012, y.min() - 0.012, x.max() + 0.012, y.max() + 0.012]
        rows.append(
            {"order": number, "path": timed_path(points, 0.06).tolist(), "window_m": window, "color_srgb": INK,
             "reload": False, "wait_s": 0.0, "separates": "a | b"} | change
        )  # fmt: skip
    return pa.Table.from_pylist(rows)


def made(todo: pa.Table, recorded: pa.Table | None = None, age_m: float = 0.0) -> list[dict[str, Any]]:
    robot = VirtualRobot(Studio(load_world("round_brush"), 0))
    guarded = GuardedRobot(robot, envelope_for(TOOL, robot.canvas_size_m))
    table = example_table(4) if recorded is None else recorded
    rows = follow(guarded, TOOL, todo, recorded=table, session="next", tool_age_m=age_m)
    assert rows.schema.equals(table.schema.remove_metadata())
    return list(rows.to_pylist())


@pytest.fixture(scope="module")
def rows() -> list[dict[str, Any]]:
    return made(actions({}, {"wait_s": 30.0, "reload": True}, {"color_srgb": RED}), age_m=1.5)


def test_each_action_is_made_where_and_in_the_paint_it_asks_for(rows: list[dict[str, Any]]) -> None:
    asked = actions({}, {}, {"color_srgb": RED}).to_pylist()
    for row, action in zip(rows, asked, strict=True):
        np.testing.assert_allclose(np.array(row["path"])[:, 1:], np.array(action["path"])[:, 1:], atol=1e-6)
        np.testing.assert_allclose(row["window_m"], action["window_m"], atol=1.01e-3)  # on whole pixels
        before, after = (decode_png(row[name]["bytes"]).astype(int) for name in ("before", "after"))
        assert before.min() > 180
        scale = after.shape[1] / (row["window_m"][2] - row["window_m"][0])
        assert scale == pytest.approx(1000, rel=0.02)  # as fine as the recording
        middle = np.array(row["path"])[8]
        column, line = (middle[1] - row["window_m"][0]) * scale, (row["window_m"][3] - middle[2]) * scale
        np.testing.assert_allclose(after[int(line), int(column)], 255 * np.array(action["color_srgb"]), atol=70)


def test_dips_waits_and_wear_are_recorded_as_they_happened(rows: list[dict[str, Any]]) -> None:
    assert [row["since_reload"] for row in rows] == [0, 0, 0]  # the first of a session, as asked, and the other paint
    assert [row["order"] for row in rows] == [0, 1, 2]
    assert [row["action_id"] for row in rows] == [3, 4, 5]  # the recording's are 0 to 2
    seen_s = [row["t_after_s"] - row["t_start_s"] - row["path"][-1][0] for row in rows]
    assert seen_s[0] > 30 > seen_s[1] > 1  # the wait before a stroke is before the photograph of the one before it
    assert rows[0]["tool_age_m"] == pytest.approx(1.5) and rows[1]["tool_age_m"] > 1.53


def test_the_table_that_goes_on_keeps_the_contract(rows: list[dict[str, Any]], tmp_path: Any) -> None:
    known = example_table(4).append_column("humidity", pa.array([0.4] * 4))
    more = pa.Table.from_pylist([row | {"humidity": None} for row in rows], schema=known.schema)
    write_table(tmp_path / "strokes", pa.concat_tables([known, more]), CONTRACT, "# Card")
    checked = read_table(tmp_path / "strokes", CONTRACT)
    assert checked.table.num_rows == 7 and not checked.quarantined


def test_strokes_without_times_are_made_at_the_usual_speed() -> None:
    (action,) = actions({}).to_pylist()
    (row,) = made(actions({"path": [[float("nan"), *point[1:]] for point in action["path"]]}))
    path = np.array(row["path"])
    length = np.hypot(*np.diff(path[:, 1:3], axis=0).T).sum()
    assert 0.5 < length / path[-1, 0] / TOOL.speed_m_s <= 1.01


def test_what_a_robot_must_not_do_is_refused() -> None:
    (action,) = actions({}).to_pylist()
    too_deep = [[*point[:3], -0.02, point[4]] for point in action["path"]]
    with pytest.raises(PentimentoError, match="z"):
        made(actions({"path": too_deep}))


def test_proposed_colour_other_than_the_pens_ink_is_rejected() -> None:
    pen = load_tool("marker")
    robot = VirtualRobot(Studio(load_world("marker"), 0))
    with pytest.raises(ContractError, match="tool file"):
        follow(robot, pen, actions({"color_srgb": RED}), recorded=example_table(4), session="next", tool_age_m=0.0)


def test_a_robot_goes_on_with_one_tool_on_a_known_canvas() -> None:
    table = example_table(4)
    assert tool_of(table) == "round_brush"
    with pytest.raises(ContractError, match="no rows"):
        tool_of(table.slice(0, 0))
    rows = table.to_pylist()
    rows[2]["tool"] = "marker"
    with pytest.raises(ContractError, match="marker, round_brush"):
        tool_of(pa.Table.from_pylist(rows, schema=table.schema))
    floating = [row | {"frame": "stroke"} for row in table.to_pylist()]
    with pytest.raises(ContractError, match="frame"):
        tool_of(pa.Table.from_pylist(floating, schema=table.schema))
