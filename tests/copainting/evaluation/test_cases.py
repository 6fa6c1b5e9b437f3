"""Prompts on canvases of other prompts."""

import pytest

from pentimento.contracts import scenes
from pentimento.contracts.errors import ContractError
from pentimento.copainting.evaluation.cases import choose_cases, plain_caption
from pentimento.copainting.scenes.drawn import ScenesConfig, build_scenes


def test_the_canvas_shows_nothing_that_is_asked_for() -> None:
    table = build_scenes(ScenesConfig(60, 32, 0.0, 0.9, 4, 0), lambda *_: None)
    cases = choose_cases(table, 40, 0)
    assert len(cases) == 40
    assert all(case.objects and not set(case.objects) & set(case.other_objects) for case in cases)
    colors = {color for row in table["colors"].to_pylist() for color in row} - {"orange"}  # a fruit, in some worlds
    assert not any(colors & set(case.caption.split()) for case in cases)


def test_a_case_does_not_depend_on_how_many_are_chosen() -> None:
    table = scenes.example_table(20)
    few, many = choose_cases(table, 3, 1), choose_cases(table, 20, 1)
    for one, same in zip(few, many, strict=False):
        assert one.caption == same.caption and (one.other_image == same.other_image).all()
    assert any((a.other_image != b.other_image).any() for a, b in zip(few, choose_cases(table, 3, 2), strict=True))


def test_a_caption_without_colours_is_preferred() -> None:
    row = {"caption": "a red cup", "captions": ["a red cup", "a cup"], "colors": ["red"]}
    assert plain_caption(row) == "a cup"
    assert plain_caption(row | {"captions": None, "colors": None}) == "a red cup"


def test_one_scene_is_not_enough() -> None:
    with pytest.raises(ContractError, match="two or more"):
        choose_cases(scenes.example_table(1), 5, 0)
