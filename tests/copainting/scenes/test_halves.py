"""One thing in one half of the sheet; the other half stays free."""

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.copainting.scenes.drawn import ScenesConfig, build_scenes
from pentimento.copainting.scenes.halves import half_scenes, opposite

SIDE = 32


def drawn(number: int = 40) -> pa.Table:
    return build_scenes(ScenesConfig(number, SIDE, 0.0, 0.0, 4, 0), lambda *_: None)


def test_each_thing_lies_in_the_half_that_its_row_says() -> None:
    rows = half_scenes(drawn(), 8, 0).to_pylist()
    assert [row["arrangement"] for row in rows] == 2 * ["left", "right", "upper", "lower"]
    for row in rows:
        there = decode_png(row["regions"]["bytes"]) > 0
        y, x = (places.mean() / SIDE - 0.5 for places in np.nonzero(there))
        along, sign = {"left": (x, -1), "right": (x, 1), "upper": (y, -1), "lower": (y, 1)}[row["arrangement"]]
        assert sign * along > 0.15
        assert np.ptp(np.nonzero(there), axis=1).max() < 0.6 * SIDE
        assert len(row["objects"]) == 1 and row["scene_id"].endswith("/" + row["arrangement"])


def test_facing_halves_do_not_overlap() -> None:
    rows = half_scenes(drawn(), 8, 0).to_pylist()
    for row in rows:
        there = decode_png(row["regions"]["bytes"]) > 0
        for other in rows:
            if other["arrangement"] == opposite(row["arrangement"]):
                assert (there & (decode_png(other["regions"]["bytes"]) > 0)).mean() < 0.02
    assert all(opposite(opposite(name)) == name != opposite(name) for name in ("left", "right", "upper", "lower"))


def test_a_row_does_not_depend_on_how_many_there_are_and_no_two_are_the_same() -> None:
    table = drawn(6)
    few, many = half_scenes(table, 2, 0).to_pylist(), half_scenes(table, 12, 0).to_pylist()
    assert many[:2] == few
    alone = sum(len(kinds) == 1 for kinds in table["objects"].to_pylist())
    assert 0 < alone < 12  # so they come again, in other halves
    assert len({row["scene_id"] for row in many[: 4 * alone]}) == min(12, 4 * alone)
    assert half_scenes(table, 12, 1).to_pylist() != many


def test_none_are_asked_for_or_none_can_be_made() -> None:
    assert half_scenes(drawn(4), 0, 0).num_rows == 0
    crowded = drawn()
    crowded = crowded.filter(pa.array([len(kinds) > 1 for kinds in crowded["objects"].to_pylist()]))
    with pytest.raises(ContractError, match="one thing alone"):
        half_scenes(crowded, 1, 0)
