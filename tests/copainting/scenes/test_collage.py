"""Cutting objects out, putting them into halves of a sheet, and half scenes."""

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.copainting.scenes.collage import (
    half_scenes,
    opposite,
    pairs_shown,
    random_halves,
)
from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes

WHITE = np.full((40, 40, 3), 255, np.uint8)


def square(side: int) -> tuple[np.ndarray, np.ndarray]:
    """A dark square in a corner of a grey picture, and its region."""
    image, regions = np.full((40, 40, 3), 128, np.uint8), np.zeros((40, 40), np.uint8)
    image[2 : 2 + side, 2 : 2 + side], regions[2 : 2 + side, 2 : 2 + side] = 10, 1
    return image, regions


def test_random_halves_face_each_other() -> None:
    for seed in range(20):
        one, other = random_halves(np.random.default_rng(seed))
        assert one.x + other.x == pytest.approx(1) and one.y + other.y == pytest.approx(1)
        assert max(abs(one.x - other.x), abs(one.y - other.y)) > 0.4


def test_pairs_shown_are_the_pairs_of_kinds_of_each_scene() -> None:
    shown = pairs_shown([["cat"], ["cat", "dog"], ["sun", "sun"], ["a", "b", "c"]])
    assert shown == {frozenset(pair) for pair in (("cat", "dog"), ("sun",), ("a", "b"), ("a", "c"), ("b", "c"))}


SIDE = 32


def drawn(number: int = 40) -> pa.Table:
    return build_scenes(ScenesConfig(number, SIDE, 0.0, 0.0, 4, 0), lambda *_: None)


def test_half_scene_places_its_thing_in_the_named_half() -> None:
    rows = half_scenes(drawn(), 8, 0).to_pylist()
    assert [row["arrangement"] for row in rows] == 2 * ["left", "right", "upper", "lower"]
    for row in rows:
        there = decode_png(row["regions"]["bytes"]) > 0
        y, x = (places.mean() / SIDE - 0.5 for places in np.nonzero(there))
        along, sign = {"left": (x, -1), "right": (x, 1), "upper": (y, -1), "lower": (y, 1)}[row["arrangement"]]
        assert sign * along > 0.15
        assert np.ptp(np.nonzero(there), axis=1).max() < 0.6 * SIDE
        assert len(row["objects"]) == 1 and row["scene_id"].endswith("/" + row["arrangement"])


def test_half_scenes_of_facing_halves_do_not_overlap() -> None:
    rows = half_scenes(drawn(), 8, 0).to_pylist()
    for row in rows:
        there = decode_png(row["regions"]["bytes"]) > 0
        for other in rows:
            if other["arrangement"] == opposite(row["arrangement"]):
                assert (there & (decode_png(other["regions"]["bytes"]) > 0)).mean() < 0.02
    assert all(opposite(opposite(name)) == name != opposite(name) for name in ("left", "right", "upper", "lower"))


def test_half_scene_does_not_depend_on_their_number_and_is_unique() -> None:
    table = drawn(6)
    few, many = half_scenes(table, 2, 0).to_pylist(), half_scenes(table, 12, 0).to_pylist()
    assert many[:2] == few
    alone = sum(len(kinds) == 1 for kinds in table["objects"].to_pylist())
    assert 0 < alone < 12  # so they come again, in other halves
    assert len({row["scene_id"] for row in many[: 4 * alone]}) == min(12, 4 * alone)
    assert half_scenes(table, 12, 1).to_pylist() != many


def test_half_scenes_may_be_none_and_need_a_single_thing() -> None:
    assert half_scenes(drawn(4), 0, 0).num_rows == 0
    crowded = drawn()
    crowded = crowded.filter(pa.array([len(kinds) > 1 for kinds in crowded["objects"].to_pylist()]))
    with pytest.raises(ContractError, match="one thing alone"):
        half_scenes(crowded, 1, 0)
