"""Edits of scenes: the input lacks things, the target is the scene, and the caption names them."""

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png, encode_png
from pentimento.copainting.scenes.collage import pairs_shown, without
from pentimento.copainting.scenes.edits import pairs_of, scene_edits, scenes_of
from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes


def two_things() -> tuple[np.ndarray, np.ndarray]:
    image = np.full((40, 60, 3), (200, 220, 240), np.uint8)
    regions = np.zeros((40, 60), np.uint8)
    image[10:25, 8:22], regions[10:25, 8:22] = (200, 30, 30), 1
    image[12:30, 38:52], regions[12:30, 38:52] = (30, 90, 30), 2
    return image, regions


def test_without_replaces_only_removed_regions() -> None:
    image, regions = two_things()
    less = without(image, regions, np.array([1]))
    assert np.abs(less[regions == 1].astype(int) - (200, 220, 240)).max() <= 5  # Telea rounds
    assert (less[regions == 2] == image[regions == 2]).all()
    assert (less[:, 30:] == image[:, 30:]).all()


def test_without_keeps_touching_things() -> None:
    image, regions = two_things()
    regions[10:25, 22:38], image[10:25, 22:38] = 2, (30, 90, 30)
    less = without(image, regions, np.array([1]))
    assert (less[regions == 2] == image[regions == 2]).all()


def test_input_of_each_edit_lacks_part_of_its_target() -> None:
    table = scenes.example_table(40)
    pairs = scene_edits(table, 2, seed=1)
    assert len(pairs) == 80
    images = {decode_png(row["image"]["bytes"]).tobytes() for row in table.to_pylist()}
    assert all((pair.input != pair.target).any(axis=-1).mean() > 0.01 for pair in pairs)
    drawn = [pair for pair in pairs if (np.ptp(pair.target, axis=-1) == 0).all()]
    in_color = [pair for pair in pairs if pair.target.tobytes() in images]
    assert len(drawn) > 10 and len(in_color) > 10
    assert all((pair.input >= pair.target).all() for pair in drawn)  # a pen only adds ink
    papers = [pair for pair in in_color if len(np.unique(pair.input)) == 1]
    assert 0 < len(papers) < len(in_color)


def drawn_scenes(number: int) -> pa.Table:
    return build_scenes(ScenesConfig(number, 32, 0.0, 0.0, 4, 0), lambda *_: None)


def test_edit_captions_name_the_whole_or_the_missing_things() -> None:
    table = drawn_scenes(60)
    media = ("with a marker", "in colours")
    known = {
        f"{caption}, {words}" for captions in table["captions"].to_pylist() for caption in captions for words in media
    }
    pairs = scene_edits(table, 2, 0)
    assert all(pair.caption.endswith(media) for pair in pairs)
    short = [pair for pair in pairs if pair.caption not in known]
    assert 0 < len(short) < len(pairs)
    things = sorted({kind for kinds in table["objects"].to_pylist() for kind in kinds})
    assert all(any(kind in pair.caption for kind in things) for pair in short)
    colors = {color for row in table["colors"].to_pylist() for color in row} - {"orange"}
    drawn = [pair for pair in pairs if (np.ptp(pair.target, axis=-1) == 0).all()]
    assert drawn and not any(colors & set(pair.caption.split()) for pair in drawn)


def test_edits_combine_only_kinds_that_a_scene_shows_together() -> None:
    table = drawn_scenes(80)
    seen = pairs_shown(table["objects"].to_pylist())
    kinds = sorted({kind for row in table["objects"].to_pylist() for kind in row})
    requests = [pair.caption.rpartition(", ")[0] for pair in scene_edits(table, 3, 2)]
    named = [[kind for kind in kinds if f" {kind} " in f" {request} "] for request in requests]
    together = [frozenset(pair) for pair in named if len(pair) == 2]
    assert len(together) > 10 and set(together) <= seen


def test_edit_depends_on_its_own_index_only() -> None:
    table = scenes.example_table(6)
    one, many = scene_edits(table, 1, 5), scene_edits(table, 2, 5)
    assert all((a.input == b.input).all() and a.caption == b.caption for a, b in zip(one, many[::2], strict=True))
    other = scene_edits(table, 2, 6)
    assert any((a.input != b.input).any() or a.caption != b.caption for a, b in zip(many, other, strict=True))


def test_co_paintings_of_a_split_become_pairs() -> None:
    table = copaintings.example_table(10)
    pairs = pairs_of(table, "val")
    rows = [row for row in table.to_pylist() if row["split"] == "val"]
    assert len(pairs) == len(rows) == 2
    assert (pairs[0].input == decode_png(rows[0]["partial"]["bytes"])).all()
    assert (pairs[0].target == decode_png(rows[0]["full"]["bytes"])).all()


def test_scenes_without_splits_are_split_by_index() -> None:
    table = scenes.example_table(40).drop_columns(["split"])
    training, held_out = scenes_of(table, "train"), scenes_of(table, "val")
    assert (training.num_rows, held_out.num_rows) == (36, 4)
    assert not set(training["scene_id"].to_pylist()) & set(held_out["scene_id"].to_pylist())
    named = scenes.example_table(40)
    assert scenes_of(named, "test").num_rows == named["split"].to_pylist().count("test")


def test_rejects_mask_of_another_size() -> None:
    rows = scenes.example_table(2).to_pylist()
    rows[1]["regions"] = {"bytes": encode_png(np.zeros((5, 5), np.uint8)), "path": None}
    with pytest.raises(ContractError, match="Scene 1: its regions"):
        scene_edits(pa.Table.from_pylist(rows), 1, 0)
