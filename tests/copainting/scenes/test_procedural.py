"""Procedural scenes: reproducibility, disjoint splits, regions and captions."""

from collections import Counter
from itertools import pairwise

import cv2
import numpy as np
import pytest

from pentimento.contracts.images import decode_png
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.schema import row_faults
from pentimento.copainting.scenes.compositions import COLORS, THINGS, Splits, Thing, compose
from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes, draw_scene, paint
from pentimento.copainting.scenes.things import DRAWINGS, KINDS

CONFIG = ScenesConfig(scenes=120, side_px=64, val_share=0.1, test_share=0.2, wordings=4, seed=3)


@pytest.fixture(scope="module")
def rows() -> list[dict]:
    table = build_scenes(CONFIG, lambda *_: None)
    assert row_faults(table, CONTRACT) == [None] * CONFIG.scenes
    return table.to_pylist()


def test_procedural_scene_depends_on_seed_and_number_only() -> None:
    few = build_scenes(ScenesConfig(3, 64, 0.1, 0.2, 4, 3), lambda *_: None).to_pylist()
    more = build_scenes(ScenesConfig(6, 64, 0.1, 0.2, 4, 3), lambda *_: None).to_pylist()
    assert few == more[:3]
    assert few != build_scenes(ScenesConfig(3, 64, 0.1, 0.2, 4, 4), lambda *_: None).to_pylist()


def test_at_least_20_kinds_lie_inside_the_unit_square() -> None:
    assert len(KINDS) >= 20
    for parts in DRAWINGS.values():
        points = np.concatenate([part.points for part in parts])
        assert (points > -0.1).all() and (points < 1.1).all()
        assert np.ptp(points, axis=0).max() > 0.7  # it fills the square one way


def test_splits_share_no_composition(rows: list[dict]) -> None:
    splits = Splits(CONFIG.seed)
    seen: dict[str, set] = {split: set() for split in ("train", "val", "test")}
    for row in rows:
        kinds = row["objects"]
        seen[row["split"]] |= {frozenset(pair) for i, a in enumerate(kinds) for pair in [(a, b) for b in kinds[:i]]}
        seen[row["split"]] |= set(zip(kinds, row["colors"], strict=True))
    assert all(splits.of_thing(Thing(*key)) == "train" for key in seen["train"] if isinstance(key, tuple))
    assert all(splits.of_pair(*key) == "train" for key in seen["train"] if isinstance(key, frozenset))
    for row in (row for row in rows if row["split"] == "test"):
        things = [Thing(kind, color) for kind, color in zip(row["objects"], row["colors"], strict=True)]
        pairs = [(a.kind, b.kind) for i, a in enumerate(things) for b in things[:i]]
        assert "test" in {splits.of_thing(t) for t in things} | {splits.of_pair(*p) for p in pairs}


def test_each_kind_has_equally_many_held_out_pairs_and_colours() -> None:
    splits = Splits(11)
    for split, pairs in (("test", 4), ("val", 2)):
        for kind in KINDS:
            assert sum(splits.of_pair(kind, other) == split for other in KINDS if other != kind) == pairs
            assert sum(splits.of_thing(Thing(kind, color)) == split for color in COLORS) == 1


def test_split_fractions_follow_the_config() -> None:
    table = build_scenes(ScenesConfig(600, 16, 0.1, 0.2, 1, 0), lambda *_: None)
    counts = Counter(table.column("split").to_pylist())
    assert counts["test"] == pytest.approx(120, abs=30) and counts["val"] == pytest.approx(60, abs=22)
    trained = table.filter(np.array(table.column("split").to_pylist()) == "train")
    assert {kind for kinds in trained.column("objects").to_pylist() for kind in kinds} == set(KINDS)


def test_regions_follow_objects_and_arrangement(rows: list[dict]) -> None:
    for row in rows:
        regions = decode_png(row["regions"]["bytes"])
        assert set(np.unique(regions)) == set(range(len(row["objects"]) + 1))
        middles = [np.argwhere(regions == label).mean(0) for label in range(1, len(row["objects"]) + 1)]
        if row["arrangement"] in ("beside", "row"):
            assert all(a[1] < b[1] for a, b in pairwise(middles))
        if row["arrangement"] in ("above", "over_two"):
            assert all(middles[0][0] < other[0] for other in middles[1:])


def test_background_has_two_colours_away_from_things() -> None:
    drawing = draw_scene(5, CONFIG, Splits(3)).drawing
    image, regions = paint(drawing, 64)
    near = cv2.dilate(regions, np.ones((5, 5), np.uint8)) > 0
    row = round(drawing.horizon * 64)
    for part, color in ((slice(0, row - 1), drawing.upper), (slice(row + 1, 64), drawing.lower)):
        assert (~near[part]).any()
        assert np.abs(image[part][~near[part]].astype(float) - color).max() <= 1


def test_captions_name_all_kinds_and_every_second_one_no_colour(rows: list[dict]) -> None:
    for row in rows:
        assert row["caption"] == row["captions"][0] and len(row["captions"]) == CONFIG.wordings
        for number, caption in enumerate(row["captions"]):
            assert all(kind in caption for kind in row["objects"])
            named = any(color in caption.split() for color in row["colors"])
            assert named == (number % 2 == 0)
    assert len({text for row in rows for text in row["captions"]}) > 2 * len(rows)


def test_spatial_relations_in_captions_are_true(rows: list[dict]) -> None:
    """Who is named first in "left of" and "above" is the one on the left and above."""
    checked = 0
    for row in (row for row in rows if len(row["objects"]) == 2):
        first, second = row["objects"]
        for caption in row["captions"]:
            for words, swapped in (("left of", False), ("right of", True), (" over ", False), (" below ", True)):
                if words in caption and " with " not in caption:
                    order = caption.index(first) < caption.index(second)
                    assert order != swapped, caption
                    checked += 1
    assert checked > 20


def test_every_arrangement_is_drawn(rows: list[dict]) -> None:
    assert {row["arrangement"] for row in rows} == set(THINGS)


def test_rejects_empty_training_split_and_unknown_split() -> None:
    with pytest.raises(ValueError, match="leave a share for training"):
        ScenesConfig(10, 64, 0.5, 0.5, 2, 0)
    with pytest.raises(ValueError, match="no split 'tset'"):
        compose("tset", Splits(0), np.random.default_rng(0))
