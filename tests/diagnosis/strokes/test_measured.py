"""Covariates and paints of measured strokes."""

from decimal import Decimal

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.images import image_cell
from pentimento.diagnosis.strokes.measured import common_resolution, covariates_of, mixes

ROWS = 40


def recorded(**columns: np.ndarray) -> pa.Table:
    """Strokes of two sessions, executed in another order than they are listed, with a dip every five."""
    order = np.random.default_rng(0).permutation(ROWS)
    known = {
        "session": [f"session_{k // 20}" for k in order],
        "order": order.astype(np.int32),
        "reload_id": (order // 5).astype(np.int32),
    }
    given = {name: pa.array(values[order], from_pandas=False) for name, values in columns.items()}
    return pa.table(known | given)


def test_interpolates_few_missing_values_in_execution_order() -> None:
    age = 2.0 + 0.1 * np.arange(ROWS)
    gappy = age.copy()
    gappy[[7, 23, 24]] = np.nan
    table = recorded(tool_age_m=gappy)
    np.testing.assert_allclose(covariates_of(table)["tool_age_m"], age[table["order"].to_numpy()])


def test_interpolates_load_covariates_within_a_load() -> None:
    ink = 0.04 * (np.arange(ROWS) % 5)
    gappy = ink.copy()
    gappy[[11, 28]] = np.nan
    table = recorded(ink_since_reload_m=gappy)
    np.testing.assert_allclose(covariates_of(table)["ink_since_reload_m"], ink[table["order"].to_numpy()])


def test_keeps_mostly_missing_and_meaningful_nan() -> None:
    seldom = np.where(np.arange(ROWS) % 3 == 0, np.nan, 1.0 + np.arange(ROWS))
    blank = np.where(np.arange(ROWS) == 9, np.nan, 5.0 + np.arange(ROWS))
    found = covariates_of(recorded(humidity=seldom, wet_age_s=blank))
    assert np.isnan(found["humidity"]).sum() == np.isnan(seldom).sum()
    assert np.isnan(found["wet_age_s"]).sum() == 1


def test_numbers_of_every_kind_are_covariates() -> None:
    """Nanoseconds of a clock, which a float rounds, and decimals of a database."""
    table = recorded()
    order = table["order"].to_numpy()
    clock = 1_700_000_000_000_000_001 + 10**9 * order.astype(np.int64)
    humidity = pa.array([Decimal(int(k)) / 4 for k in order])
    found = covariates_of(table.append_column("stamp_ns", pa.array(clock)).append_column("humidity", humidity))
    np.testing.assert_allclose(found["stamp_ns"] - found["stamp_ns"].min(), 1e9 * order, rtol=1e-6)
    np.testing.assert_array_equal(found["humidity"], order / 4)


def test_colour_is_a_separate_paint_in_sessions_with_enough_blocks() -> None:
    session, block = np.repeat([0, 1], 40), np.arange(80) // 4
    color = np.where(np.arange(80)[:, None] % 2 == 0, [0.1, 0.2, 0.3], [0.8, 0.2, 0.1])
    found = mixes(color, session, block)
    assert len(np.unique(found)) == 4
    for each in np.unique(found):
        assert len(np.unique(session[found == each])) == 1
        assert len(np.unique(color[found == each], axis=0)) == 1


def test_session_with_few_loads_has_no_own_mix() -> None:
    session, block = np.repeat([0, 1], [70, 10]), np.arange(80) // 4
    color = np.tile([0.1, 0.2, 0.3], (80, 1))
    np.testing.assert_array_equal(mixes(color, session, block), 0)


def test_resolution_is_that_of_the_largest_window_wherever_its_row_is() -> None:
    """A window of 200 x 100 pixels at 10 px/mm beside ten of 100 x 100: two pixels become one."""
    sizes_px = [(100, 100)] * 10 + [(100, 200)]
    rows = [
        {
            "window_m": [0.0, 0.0, width * 1e-4, height * 1e-4],
            "before": image_cell(np.zeros((height, width, 3), np.uint8)),
        }
        for height, width in sizes_px
    ]
    for order in (rows, rows[::-1]):
        assert common_resolution(pa.Table.from_pylist(order)) == pytest.approx(5000)
