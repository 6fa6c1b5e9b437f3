"""Scenes of named things: occlusion, splits, wording."""

import numpy as np
import pytest

from pentimento.contracts.scenes import phrase
from pentimento.copainting.drawings.pairs import _others, drawn_pairs
from pentimento.copainting.drawings.scenes import (
    RELATION_SHARES,
    DrawnScene,
    Placed,
    caption,
    draw_scene,
    plural,
    render_scene,
    split_of_scene,
)
from pentimento.copainting.drawings.sources import nouns_of

NOUNS = ["cat", "tree", "house", "sun", "apple", "fish", "car", "star", "boot", "key", "egg", "moon"]
SIDE = 64


def scene_of(*things: Placed) -> DrawnScene:
    return DrawnScene("behind", things, tuple(range(len(things))), None, (250, 250, 247), 0.015)


def placed(noun: str, x: float, y: float, size: float) -> Placed:
    return Placed(noun, "openmoji", x, y, size, 0.0, False)


def test_thing_in_front_hides_the_lines_behind_it() -> None:
    behind, front = placed("tree", 0.5, 0.5, 0.5), placed("apple", 0.5, 0.5, 0.9)
    alone = render_scene(scene_of(front), [0], "marker", side_px=SIDE).image
    both = render_scene(scene_of(behind, front), [0, 1], "marker", side_px=SIDE)
    # The apple's middle covers the whole tree.
    assert np.abs(both.image[20:44, 20:44].astype(int) - alone[20:44, 20:44]).max() <= 2
    assert set(np.unique(both.regions[24:40, 24:40])) == {2}


def test_canvas_without_a_thing_shows_the_others_whole() -> None:
    tree, apple = placed("tree", 0.5, 0.5, 0.5), placed("apple", 0.5, 0.5, 0.9)
    scene = scene_of(tree, apple)
    np.testing.assert_array_equal(
        render_scene(scene, [0], "colour", side_px=SIDE).image,
        render_scene(scene_of(tree), [0], "colour", side_px=SIDE).image,
    )


def test_marker_lines_are_at_least_as_wide_as_the_pen() -> None:
    ink = {}
    for line in (0.015, 0.045):
        scene = DrawnScene("alone", (placed("sun", 0.5, 0.5, 0.5),), (0,), None, (250, 250, 247), line)
        ink[line] = (255.0 - render_scene(scene, [0], "marker", side_px=128).image).mean()
    assert ink[0.045] > 1.7 * ink[0.015]


def test_placed_thing_has_its_centre_and_size() -> None:
    image = render_scene(scene_of(placed("house", 0.3, 0.6, 0.4)), [0], "marker", side_px=128).image
    rows, columns = np.flatnonzero((image < 128).any((1, 2))), np.flatnonzero((image < 128).any((0, 2)))
    assert abs((columns[0] + columns[-1] + 1) / 2 / 128 - 0.3) < 0.02
    assert abs((rows[0] + rows[-1] + 1) / 2 / 128 - 0.6) < 0.02
    assert abs(max(np.ptp(rows), np.ptp(columns)) + 1 - 0.4 * 128) <= 3


def test_splits_share_no_pair_and_no_relation_of_a_noun() -> None:
    generator = np.random.default_rng(0)
    seen: dict[str, set[object]] = {"train": set(), "test": set()}
    for split, found in seen.items():
        for _ in range(300):
            scene = draw_scene(split, NOUNS, "openmoji", alone_share=0.0, generator=generator)
            names = {thing.noun for thing in scene.things}
            assert split_of_scene(scene.relation, names) == split
            found.add((scene.relation, frozenset(names)))
    assert not seen["train"] & seen["test"]
    assert {relation for relation, _ in seen["train"]} == set(RELATION_SHARES) - {"alone"}


def test_nothing_lies_off_the_sheet() -> None:
    generator = np.random.default_rng(1)
    for _ in range(400):
        for thing in draw_scene("train", NOUNS, "openmoji", generator=generator).things:
            assert min(thing.x, thing.y) - thing.size / 2 > -0.04 and max(thing.x, thing.y) + thing.size / 2 < 1.04


@pytest.mark.parametrize(
    ("word", "several", "single"),
    [
        ("cat", "cats", "a cat"),
        ("owl", "owls", "an owl"),
        ("fish", "fish", "a fish"),
        ("tropical fish", "tropical fish", "a tropical fish"),
        ("kitchen knife", "kitchen knives", "a kitchen knife"),
        ("cherry", "cherries", "a cherry"),
        ("toothbrush", "toothbrushes", "a toothbrush"),
        ("donkey", "donkeys", "a donkey"),
        ("scissors", "scissors", "scissors"),
    ],
)
def test_plural_and_article(word: str, several: str, single: str) -> None:
    assert (plural(word), phrase(word)) == (several, single)


def test_captions_name_every_thing() -> None:
    things = (placed("owl", 0.3, 0.5, 0.4), placed("star", 0.7, 0.5, 0.4))
    scene = DrawnScene("beside", things, (0, 1), None, (250, 250, 247), 0.015)
    generator = np.random.default_rng(2)
    for _ in range(20):
        text = caption(scene, generator)
        assert "owl" in text and "star" in text


def test_pairs_add_a_thing_that_fills_the_window_and_name_the_medium() -> None:
    pairs = drawn_pairs(40, "train", nouns_of("openmoji")[:40], blank_share=0.3, side_px=SIDE, seed=5)
    again = drawn_pairs(3, "train", nouns_of("openmoji")[:40], blank_share=0.3, side_px=SIDE, seed=5)
    for pair, same in zip(pairs, again, strict=False):
        np.testing.assert_array_equal(pair.target, same.target)
        assert pair.caption == same.caption
    for pair in pairs:
        assert pair.input.shape == pair.target.shape == (SIDE, SIDE, 3)
        assert pair.caption.endswith((", with a marker", ", in colours"))
        assert (pair.input != pair.target).any()
        if pair.caption.endswith("marker"):
            assert (pair.target <= pair.input).all()  # ink stays


def test_pairs_on_blank_canvases_show_the_thing_in_the_middle() -> None:
    pairs = drawn_pairs(40, "train", ("cat", "egg"), blank_share=1.0, side_px=SIDE, seed=1)
    blank = [pair for pair in pairs if np.ptp(pair.input.reshape(-1, 3), axis=0).max() == 0]
    assert len(blank) > 25
    for pair in blank:
        rows, columns = np.nonzero(np.abs(pair.target.astype(int) - pair.target[0, 0]).max(-1) > 60)
        for places in (rows, columns):
            assert abs((places.min() + places.max()) / 2 - (SIDE - 1) / 2) < 0.06 * SIDE
        assert abs(max(np.ptp(rows), np.ptp(columns)) + 1 - 0.875 * SIDE) <= 3


def test_other_things_of_a_pair_are_in_its_split() -> None:
    generator = np.random.default_rng(4)
    for split in ("train", "test"):
        for _ in range(30):
            others = _others("cat", split, nouns_of("openmoji"), generator)
            assert all(split_of_scene("beside", ("cat", other.noun)) == split for other in others)
