"""Each contract's example table: valid, complete, deterministic, and plausible."""

from types import ModuleType

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts import copaintings, demonstrations, pushes, scenes, strokes
from pentimento.contracts.images import decode_png
from pentimento.contracts.schema import arrow_schema, row_faults

MODULES = [strokes, pushes, demonstrations, scenes, copaintings]
every_contract = pytest.mark.parametrize("module", MODULES, ids=lambda module: module.CONTRACT.name)


@every_contract
def test_examples_keep_their_contract(module: ModuleType) -> None:
    table = module.example_table(9)
    assert table.schema == arrow_schema(module.CONTRACT)
    assert row_faults(table, module.CONTRACT) == [None] * 9


@every_contract
def test_examples_are_deterministic_and_differ_by_seed(module: ModuleType) -> None:
    rows = module.example_table(4, 3).to_pylist()
    np.testing.assert_equal(module.example_table(4, 3).to_pylist(), rows)  # NaN equals NaN here
    for row, other in zip(rows, module.example_table(4, 4).to_pylist(), strict=True):
        assert repr(row) != repr(other)


@every_contract
def test_no_example_rows_is_an_empty_table(module: ModuleType) -> None:
    table = module.example_table(0)
    assert table.num_rows == 0 and table.schema == arrow_schema(module.CONTRACT)


def image(table: pa.Table, column: str, row: int) -> np.ndarray:
    return decode_png(table.column(column)[row].as_py()["bytes"]).astype(float)


def test_strokes_darken_the_paper_along_their_path_only() -> None:
    table = strokes.example_table(6)
    for row in range(6):
        darkened = image(table, "before", row).mean(-1) - image(table, "after", row).mean(-1)
        assert darkened.max() > 60
        assert np.median(np.abs(darkened)) < 10  # most of the window is blank


def test_repeated_actions_have_the_same_command_and_other_noise() -> None:
    table = strokes.example_table(8)
    ids = table.column("action_id").to_pylist()
    assert ids == [0, 1, 2, 3, 4, 5, 0, 1]
    paths = table.column("path").to_pylist()
    assert paths[6] == paths[0] and table.column("after")[6] != table.column("after")[0]


def test_pushes_dent_below_the_surface_by_the_commanded_depth() -> None:
    table = pushes.example_table(5)
    for row in range(5):
        scale = table.column("height_per_unit_m")[row].as_py()
        change_m = (image(table, "after", row) - image(table, "before", row)) * scale
        depth_m = table.column("action")[row].as_py()[4]
        assert 0.25 * depth_m < -change_m.min() < 1.1 * depth_m + 0.001
        assert change_m.max() > 0.05 * depth_m  # a rim


def test_copaintings_show_part_of_the_full_painting() -> None:
    table = copaintings.example_table(8)
    for row in range(8):
        partial, full = image(table, "partial", row), image(table, "full", row)
        same = (partial == full).all(-1)
        assert ((partial == 245).all(-1) | same).all()
        kept = table.column("kept")[row].as_py()
        assert same.mean() == pytest.approx(np.mean(kept), abs=0.05)
