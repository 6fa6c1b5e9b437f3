"""Prompts on canvases that show drawings of other prompts."""

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts import scenes
from pentimento.contracts.errors import ContractError
from pentimento.copainting.drawings.scenes import split_of_scene
from pentimento.copainting.evaluation.cases import (
    begun_by_others,
    choose_cases,
    composed_cases,
    paper_cases,
    plain_caption,
)
from pentimento.copainting.scenes.collage import pairs_shown
from pentimento.copainting.scenes.edits import scenes_of
from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes
from pentimento.deploy.words import taught_vocabulary


def drawn(number: int) -> tuple[pa.Table, pa.Table]:
    """Held-out scenes and those of training."""
    table = build_scenes(ScenesConfig(number, 32, 0.0, 0.5, 4, 0), lambda *_: None)
    return scenes_of(table, "test"), scenes_of(table, "train")


def test_cases_combine_kinds_that_no_training_scene_combines() -> None:
    held_out, training = drawn(300)
    cases = choose_cases(held_out, training, 20, 0)
    assert len(cases) == 20
    seen = pairs_shown(training["objects"].to_pylist())
    assert all(len(case.objects) == len(case.other_objects) == 1 for case in cases)
    assert not any(frozenset(case.objects + case.other_objects) in seen for case in cases)
    colors = {color for row in held_out["colors"].to_pylist() for color in row} - {"orange"}  # a fruit, in some worlds
    assert not any(colors & set(case.caption.split()) for case in cases)


def test_cases_place_the_requested_thing_beside_the_other() -> None:
    """Of pictures on plain grounds: where one differs from its ground, the other does not."""
    held_out, training = drawn(300)
    overlaps = []
    for case in choose_cases(held_out, training, 20, 0):
        marks = [
            np.abs(image.astype(int) - np.median(image, axis=1, keepdims=True)).max(-1) > 40
            for image in (case.image, case.other_image)
        ]
        assert all(mark.any() for mark in marks)
        overlaps.append((marks[0] & marks[1]).sum() / min(mark.sum() for mark in marks))
    assert max(overlaps) < 0.2


def test_case_does_not_depend_on_the_number_of_cases() -> None:
    table = scenes.example_table(20)
    few, many = choose_cases(table, table, 3, 1), choose_cases(table, table, 20, 1)
    for one, same in zip(few, many, strict=False):
        assert one.caption == same.caption and (one.other_image == same.other_image).all()
    others = choose_cases(table, table, 3, 2)
    assert any((a.other_image != b.other_image).any() for a, b in zip(few, others, strict=True))


def test_paper_cases_are_the_first_of_the_table() -> None:
    table = scenes.example_table(6)
    cases = paper_cases(table, 4)
    assert [case.scene_id for case in cases] == table["scene_id"].to_pylist()[:4]
    assert all(not case.other_objects and (case.other_image == 255).all() for case in cases)


def test_plain_caption_prefers_captions_without_colours() -> None:
    row = {"caption": "a red cup", "captions": ["a red cup", "a cup"], "colors": ["red"]}
    assert plain_caption(row) == "a cup"
    assert plain_caption(row | {"captions": None, "colors": None}) == "a red cup"


def test_rejects_a_single_held_out_scene() -> None:
    with pytest.raises(ContractError, match="two or more"):
        choose_cases(scenes.example_table(1), scenes.example_table(1), 5, 0)


@pytest.mark.parametrize("overlapping", [False, True])
def test_canvases_begun_by_others_show_a_held_out_pair_beside_or_over_each_other(overlapping: bool) -> None:
    cases = begun_by_others(24, "marker", side_px=96, overlapping=overlapping, seed=1)
    shares, places = [], []
    for case in cases:
        assert split_of_scene("beside", case.objects + case.other_objects) == "test"
        assert case.objects[0] in case.caption
        marks = [(image < 128).all(-1) for image in (case.image, case.other_image)]
        assert all(mark.any() for mark in marks)
        boxes = [[(np.flatnonzero(mark.any(axis))[[0, -1]]) for axis in (0, 1)] for mark in marks]
        widths = [min(a[1], b[1]) - max(a[0], b[0]) for a, b in zip(*boxes, strict=True)]
        shares.append(min(widths) > 0)
        places.append([float(ends.mean()) for ends in boxes[1]])
    assert np.mean(shares) == 1 if overlapping else np.mean(shares) < 0.7
    if not overlapping:
        assert (np.std(places, axis=0) > 96 * 0.08).all()  # anywhere
    again = begun_by_others(3, "marker", side_px=96, overlapping=overlapping, seed=1)
    assert all((a.other_image == b.other_image).all() for a, b in zip(again, cases, strict=False))


def test_canvases_begun_by_others_in_colour_show_the_same_things_in_the_same_places_filled() -> None:
    of_medium = [
        begun_by_others(6, medium, side_px=96, overlapping=False, seed=1) for medium in ("marker", "colour")
    ]  # fmt: skip
    for pen, colour in zip(*of_medium, strict=True):
        assert (pen.objects, pen.other_objects) == (colour.objects, colour.other_objects)
        assert np.ptp(pen.other_image.astype(int), axis=2).max() == 0
        filled = np.ptp(colour.other_image.astype(int), axis=2) > 0
        assert filled.sum() > (pen.other_image[..., 0] < 128).sum()


@pytest.mark.parametrize("split", ["train", "test"])
def test_composed_request_asks_for_each_thing_in_a_window_of_its_own(split: str) -> None:
    vocabulary = taught_vocabulary("named")
    cases = composed_cases(60, split, "marker", vocabulary=vocabulary, side_px=32, seed=3)
    for case in cases:
        assert 2 <= len(case.windows) == len(case.objects) <= 4
        for noun, window in zip(case.objects, case.windows, strict=True):
            assert any(
                word in case.caption for word in (*vocabulary.nouns[noun].words, *vocabulary.nouns[noun].plurals)
            )
            assert case.image[window.pixels(32)].min() < 128
    alone = composed_cases(3, split, "marker", vocabulary=vocabulary, side_px=32, seed=3)
    assert [case.caption for case in alone] == [case.caption for case in cases[:3]]
