"""Loading of push tables: heights in metres, repairs, and errors about unusable rows."""

import math
import re
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import canvas_to_pixel
from pentimento.contracts.height_maps import decode_height_m, encode_height_png, surface_at_m
from pentimento.contracts.pushes import CONTRACT, example_table
from pentimento.contracts.schema import arrow_schema
from pentimento.dynamics.pushes.measured import load_pushes

UNIT_M = 1e-6


def changed(table: pa.Table, row: int, **values: Any) -> pa.Table:
    rows = table.to_pylist()
    rows[row] |= values
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def image(height_m: Any) -> dict[str, Any]:
    return {"bytes": encode_height_png(height_m, UNIT_M), "path": None}


MOSTLY_HOLES = np.where(np.arange(60)[:, None] < 40, np.nan, np.full((60, 60), 0.04))


def heights(table: pa.Table, row: int, name: str) -> Any:
    return decode_height_m(table.column(name)[row].as_py()["bytes"], UNIT_M)


def test_loads_valid_rows_in_metres() -> None:
    table = example_table(4)
    samples, repairs = load_pushes(table)
    assert samples.before.shape == samples.after.shape == samples.known.shape == (4, 60, 60)
    assert samples.before.dtype == np.float32
    np.testing.assert_allclose(samples.before[2], heights(table, 2, "before"), atol=1e-8)
    np.testing.assert_allclose(samples.window_m, np.tile([0, 0, 0.12, 0.12], (4, 1)), atol=1e-8)
    assert samples.pixels_per_m == pytest.approx(500, rel=1e-6)
    assert samples.known.all()
    assert repairs.sentences() == []
    assert {"order", "speed_m_s", "dwell_s", "reset_id"} <= set(samples.covariates)
    assert not {"action_id", "force_n", "tool"} & set(samples.covariates)


def test_dent_lies_at_end_of_action() -> None:
    samples, _ = load_pushes(example_table(6))
    for number in range(6):
        x, y, theta, length, _ = samples.action[number]
        end = [x + length * math.cos(theta), y + length * math.sin(theta)]
        column, row = np.rint(canvas_to_pixel(end, samples.window_m[number], samples.pixels_per_m)).astype(int)
        change = samples.after[number] - samples.before[number]
        assert change[row, column] < -1e-3
        assert change[row, column] < 0.5 * change.min()


def test_fills_holes_and_keeps_them_marked() -> None:
    slope = np.linspace(0.03, 0.05, 60)[None, :] + np.zeros((60, 1))
    holed = slope.copy()
    holed[20:24, 30:36] = np.nan
    samples, repairs = load_pushes(changed(example_table(3), 1, after=image(holed)))
    assert not samples.known[1, 20:24, 30:36].any()
    assert (~samples.known).sum() == 24
    assert repairs.holes == pytest.approx(24 / (3 * 3600))
    np.testing.assert_allclose(samples.after[1], slope, atol=4e-4)
    assert np.isfinite(samples.after).all()


def test_surface_at_start_ignores_holes_of_later_scan() -> None:
    table = example_table(3)
    action, window = table.column("action")[1].as_py(), table.column("window_m")[1].as_py()
    wall = 0.03 + 0.01 * (np.arange(60)[None, :] > canvas_to_pixel(action[:2], window, 500)[0]) + np.zeros((60, 1))
    expected = surface_at_m(wall, tuple(window), *action[:2])
    for lacks in (wall > 0.035, wall < 0.035):
        after = np.where(lacks & (np.arange(60)[:, None] % 2 == 0), np.nan, wall)
        samples, _ = load_pushes(changed(table, 1, before=image(wall), after=image(after)))
        assert samples.surface_m[1] == pytest.approx(expected, abs=UNIT_M)


def test_reports_row_starting_in_hole() -> None:
    table = example_table(3)
    x, y = table.column("action")[1].as_py()[:2]
    column, row = canvas_to_pixel([x, y], table.column("window_m")[1].as_py(), 500)
    away = np.hypot(np.arange(60) - column, np.arange(60)[:, None] - row)
    _, repairs = load_pushes(changed(table, 1, before=image(np.where(away < 6, np.nan, 0.04))))
    assert "hole of 20 mm" in repairs.bad[1]


def test_subtracts_reported_tilt() -> None:
    a, b, c = 0.02, -0.03, 0.001
    column, row = np.meshgrid(np.arange(60), np.arange(60))
    x, y = (column + 0.5) / 500, 0.12 - (row + 0.5) / 500
    tilted = 0.04 + a * x + b * y + c
    table = changed(example_table(2), 1, before=image(tilted), after=image(tilted), table_plane=[a, b, c])
    samples, repairs = load_pushes(table)
    np.testing.assert_allclose(samples.before[1], 0.04, atol=2e-6)
    assert repairs.tilted == 1
    assert "tilt" in " ".join(repairs.sentences())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"height_per_unit_m": 1e-3}, "not millimetres"),
        ({"action": [60.0, 60.0, 0.0, 20.0, 5.0]}, "not millimetres"),
        ({"action": [0.06, 0.06, 0.0, -0.02, 0.005]}, "negative"),
        ({"action": [0.11, 0.06, 0.0, 0.02, 0.005]}, "leaves the window"),
        ({"before": image(MOSTLY_HOLES)}, "67% of its scan before are holes"),
    ],
)  # fmt: skip
def test_leaves_out_and_reports_unusable_row(values: dict[str, Any], message: str) -> None:
    samples, repairs = load_pushes(changed(example_table(3), 1, **values))
    assert len(samples.before) == len(samples.action) == len(samples.covariates["order"]) == 2
    assert samples.covariates["order"].tolist() == [0, 2]
    assert message in repairs.bad[1]
    assert "Row 1 (counted from 0)" in repairs.sentences()[0]


def test_rejects_table_with_too_many_bad_rows() -> None:
    table = changed(changed(example_table(5), 1, height_per_unit_m=1e-3), 3, height_per_unit_m=1e-3)
    with pytest.raises(ContractError, match=r"2 of 5 rows .*Rows 1, 3 .*at most 1 %"):
        load_pushes(table)


def test_rejects_empty_pushes_table() -> None:
    with pytest.raises(ContractError, match="no rows"):
        load_pushes(example_table(2).slice(0, 0))


def test_accepts_pinch_at_window_edge() -> None:
    pinch = {"kind": "pinch", "action": [0.11, 0.06, 0.0, 0.02, 0.005]}
    samples, repairs = load_pushes(changed(example_table(2), 1, **pinch))
    assert repairs.bad == {}
    assert samples.kind.tolist() == ["push", "pinch"]


def test_leaves_out_copied_rows() -> None:
    table = example_table(3)
    samples, repairs = load_pushes(pa.concat_tables([table, table.slice(1, 1)]))
    assert len(samples.before) == 3
    assert repairs.copies == (3,)


def test_pads_windows_of_different_size_as_unknown() -> None:
    table = example_table(2)
    small = changed(
        table, 1,
        before=image(heights(table, 1, "before")[10:50, :50]), after=image(heights(table, 1, "after")[10:50, :50]),
        window_m=[0.0, 0.02, 0.1, 0.1], action=[0.05, 0.05, 0.0, 0.01, 0.005],
    )  # fmt: skip
    samples, _ = load_pushes(small)
    assert samples.before.shape == (2, 60, 60)
    assert samples.known[1].sum() == 40 * 50
    np.testing.assert_allclose(samples.window_m[1], [0.0, -0.02, 0.12, 0.1], atol=1e-8)
    np.testing.assert_allclose(samples.before[1, :40, :50], heights(table, 1, "before")[10:50, :50], atol=1e-8)


def test_averages_fine_scans_down() -> None:
    table = example_table(2)
    whole, _ = load_pushes(table)
    coarse, _ = load_pushes(table, pixels_per_m=250)
    assert coarse.before.shape == (2, 30, 30)
    assert coarse.pixels_per_m == pytest.approx(250, rel=1e-6)
    np.testing.assert_allclose(coarse.before[0, 3, 4], whole.before[0, 6:8, 8:10].mean(), atol=1e-8)


def test_the_rounding_of_windows_does_not_decide_how_far_a_scan_is_averaged_down() -> None:
    """96 pixels over 10 cm anywhere are 960 a metre, up to single precision: 1.5 times what is asked for."""
    rng = np.random.default_rng(0)
    table = example_table(24)
    for row, (x, y) in enumerate(rng.uniform(0, 0.4, (24, 2))):
        window = np.array([x, y, x + 0.1, y + 0.1], np.float32).tolist()
        action = [x + 0.05, y + 0.05, 0.0, 0.01, 0.005]
        scan = image(0.04 + 0.001 * rng.random((96, 96)))
        table = changed(table, row, before=scan, after=scan, window_m=window, action=action, order=row)
    samples, repairs = load_pushes(table, pixels_per_m=640)
    assert repairs.bad == {} and samples.before.shape == (24, 48, 48)
    assert samples.pixels_per_m == pytest.approx(480, rel=1e-4)


def test_holes_of_a_scan_that_is_finer_than_its_points_are_explained() -> None:
    """Of pixels of 2 mm, half hold a point: of pixels of 3 mm, 1 − 0.5^2.25 = 79 % do."""
    scan = np.where(np.random.default_rng(0).random((60, 60)) < 0.52, np.nan, 0.04)
    _, repairs = load_pushes(changed(example_table(3), 1, before=image(scan)))
    assert re.search(r"at most 50% may be \(a scan made of points needs pixels of about 3(\.\d)? mm\)", repairs.bad[1])


def test_rejects_different_pixel_sizes() -> None:
    table = example_table(2)
    with pytest.raises(ContractError, match="resample them"):
        load_pushes(changed(table, 1, before=image(np.full((40, 40), 0.04)), after=image(np.full((40, 40), 0.03))))


def test_pick_keeps_columns_aligned() -> None:
    samples, _ = load_pushes(example_table(5))
    picked = samples.pick(np.array([3, 1]))
    np.testing.assert_array_equal(picked.action, samples.action[[3, 1]])
    assert picked.covariates["order"].tolist() == [3, 1]
    assert picked.pixels_per_m == samples.pixels_per_m
