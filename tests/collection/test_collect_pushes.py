import functools
import itertools
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pentimento.collection.pushes import PushCollectionConfig, collect_pushes
from pentimento.contracts.height_maps import decode_height_m, level, surface_at_m
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.schema import arrow_schema, row_faults
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.robots.tools import load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot

CONFIG = PushCollectionConfig(
    pushes=10, repeated=2, times=2, pushes_per_smoothing=(2, 3), revisit_share=0.5, edge_m=0.03, scan_pixels=64, seed=2
)


@functools.cache
def collected(tool: str) -> tuple[list[dict[str, Any]], list[tuple[str, float, int]]]:
    robot = virtual_sculpting_robot("dough", 64, seed=2)
    end_effector = load_end_effector(tool)
    guarded = GuardedSculptingRobot(robot, push_envelope_for(end_effector, robot.area_m))
    logged: list[tuple[str, float, int]] = []
    rows = collect_pushes(guarded, end_effector, "dough", CONFIG, lambda *entry: logged.append(entry))
    return rows, logged


@pytest.mark.parametrize("tool", ["ball", "gripper"])
def test_rows_keep_the_contract_and_show_their_pushes(tool: str) -> None:
    rows, logged = collected(tool)
    table = pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))
    assert row_faults(table, CONTRACT) == [None] * 10
    assert [entry[2] for entry in logged] == list(range(10))
    assert all(value > 0.01 for _, value, _ in logged)
    assert {row["kind"] for row in rows} == {"pinch" if tool == "gripper" else "push"}


def test_smoothings_are_counted_and_make_the_surface_fresh() -> None:
    rows, _ = collected("ball")
    for before, row in itertools.pairwise(rows):
        if row["reset_id"] == before["reset_id"]:
            assert row["pushes_since_reset"] == before["pushes_since_reset"] + 1
        else:
            assert (row["reset_id"], row["pushes_since_reset"]) == (before["reset_id"] + 1, 0)
    assert rows[0]["reset_id"] == 0
    for row in rows:
        heights = decode_height_m(row["before"]["bytes"], row["height_per_unit_m"])
        levelled = level(heights, row["window_m"], row["table_plane"])
        if row["pushes_since_reset"] == 0:
            assert np.nanstd(levelled) < 6e-4
            assert row["surface_height_m"] == pytest.approx(float(np.nanmedian(levelled)), abs=1e-5)
        assert surface_at_m(levelled, row["window_m"], *row["action"][:2]) < 0.06


def test_a_scan_after_and_the_next_before_show_the_same_surface() -> None:
    rows, _ = collected("ball")
    same = [(a, b) for a, b in itertools.pairwise(rows) if a["reset_id"] == b["reset_id"]]
    assert same
    for a, b in same:
        after, before = (decode_height_m(row[name]["bytes"], 1e-6) for row, name in ((a, "after"), (b, "before")))
        assert np.nanmedian(np.abs(after - before)) < 2e-4


def test_repeats_scatter_less_than_pushes_change() -> None:
    rows, _ = collected("ball")
    changes: dict[int, list[np.ndarray]] = {}
    for row in rows:
        before, after = (decode_height_m(row[name]["bytes"], 1e-6) for name in ("before", "after"))
        changes.setdefault(row["action_id"], []).append(after - before)
    pairs = [pair for pair in changes.values() if len(pair) == 2]
    assert len(pairs) == 2
    for one, other in pairs:
        assert np.nanmean((one - other) ** 2) < 0.5 * np.nanmean(one**2)
