import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.covariates import PICKUP_COLUMNS
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.dynamics.strokes.paint_pickup import paint_pickup
from pentimento.dynamics.strokes.samples import load_samples

RED, BLUE = np.array([0.5, 0.05, 0.05]), np.array([0.05, 0.1, 0.5])
"""Linear light."""
PAPER = np.array([0.9, 0.85, 0.8])


def srgb(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(linear_to_srgb(linear))


Paint = NDArray[np.float64]


def table_of(below: list[Paint | None], colors: list[Paint], loads: list[int]) -> pa.Table:
    """Strokes along the middle of windows whose `before` is paper, the left half of it painted where it says so."""
    rows = example_table(len(below)).to_pylist()
    for order, (row, paint, color, load) in enumerate(zip(rows, below, colors, loads, strict=True)):
        picture = np.broadcast_to(PAPER, (48, 64, 3)).copy()
        if paint is not None:
            picture[:40, :32] = paint
        image = np.rint(255 * srgb(picture)).astype(np.uint8)
        x = np.linspace(0.002, 0.062, 16)
        path = np.column_stack([np.linspace(0, 1, 16), x, np.full(16, 0.024), np.full(16, -0.001), np.zeros(16)])
        row |= {
            "order": order, "session": "s", "reload_id": load, "path": path.tolist(),
            "color_srgb": srgb(color).tolist(),
            "window_m": [0.0, 0.0, 0.064, 0.048], "wet_age_s": 0.0 if paint is not None else float("nan"),
            "before": {"bytes": encode_png(image), "path": None}, "after": {"bytes": encode_png(image), "path": None},
        }  # fmt: skip
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def carried(table: pa.Table) -> NDArray[np.float64]:
    """[B, 4]"""
    columns = paint_pickup(table, load_samples(table, 24, 1000.0, 1.0))
    return np.stack([columns[name] for name in PICKUP_COLUMNS], axis=1)


def test_pickup_from_fresh_paint_lasts_until_the_next_load() -> None:
    seen = carried(table_of([None, RED, None, None, None], [BLUE] * 4 + [RED], [0, 0, 0, 1, 2]))
    np.testing.assert_allclose(seen[:, 0], [0.0, 0.25, 0.5, 0.0, 0.0], atol=0.03)  # in the stroke's middle: half so far
    np.testing.assert_allclose(seen[1:3, 1:], [RED, RED], atol=0.02)
    np.testing.assert_allclose(seen[[0, 3], 1:], [BLUE, BLUE], atol=1e-3)


def test_a_thin_layer_counts_by_its_cover_and_as_its_paint() -> None:
    thin = 0.5 * RED + 0.5 * PAPER
    seen = carried(table_of([thin, None], [BLUE, RED], [0, 1]))
    assert seen[0, 0] == pytest.approx(0.125, abs=0.02)
    np.testing.assert_allclose(seen[0, 1:], RED, atol=0.02)


def test_old_paint_is_picked_up_less() -> None:
    table = table_of([RED, RED], [BLUE, RED], [0, 1])
    ages = pa.array([0.0, 60.0], type=table.schema.field("wet_age_s").type)
    seen = carried(table.set_column(table.schema.get_field_index("wet_age_s"), "wet_age_s", ages))
    assert seen[1, 0] == pytest.approx(seen[0, 0] / 2, rel=1e-6)


def test_order_of_rows_does_not_matter_but_order_of_execution() -> None:
    table = table_of([RED, None, RED, None], [BLUE, BLUE, RED, BLUE], [0, 0, 1, 0])
    turned = np.array([2, 0, 3, 1])
    np.testing.assert_allclose(carried(table.take(turned)), carried(table)[turned], atol=1e-9)


def test_where_loads_or_ages_are_not_recorded_little_or_nothing_is_known() -> None:
    table = table_of([RED, None], [BLUE, RED], [0, 0])
    unloaded = carried(table.drop_columns(["reload_id"]))
    assert unloaded[0, 0] > 0.2 and unloaded[1, 0] == 0
    blind = table.drop_columns(["wet_age_s"])
    assert paint_pickup(blind, load_samples(blind, 24, 1000.0, 1.0)) == {}
