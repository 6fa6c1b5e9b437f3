"""Blind naming: which nouns are drawn, which answers are right, and the scores of several viewers."""

import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.copainting.drawings.sources import vocabulary
from studies import blind_naming


def test_settings_draw_different_nouns() -> None:
    chosen = blind_naming.nouns_of_settings(1)
    everything = [noun for nouns in chosen.values() for noun in nouns]
    assert len(everything) == len(set(everything)) == 48
    assert set(everything) <= set(vocabulary())
    assert chosen == blind_naming.nouns_of_settings(1) != blind_naming.nouns_of_settings(2)


@pytest.mark.parametrize(
    ("answer", "noun", "right"),
    [
        ("A dog.", "dog", True),
        ("a poodle", "dog", True),
        ("sofa", "couch", True),
        ("two  cats", "cat", True),
        ("cup of tea", "coffee cup", True),
        ("a cat", "dog", False),
        ("", "dog", False),
        ("an animal", "dog", False),
    ],
)
def test_answers(answer: str, noun: str, right: bool) -> None:
    assert blind_naming.is_right(answer, noun) == right


def test_extra_answers_are_for_nouns_of_the_vocabulary() -> None:
    import tomllib

    extra = tomllib.loads((Path(blind_naming.__file__).parent / "blind_naming.toml").read_text())
    assert set(extra) <= set(vocabulary())


def test_majority_of_viewers(tmp_path: Path) -> None:
    (tmp_path / "key.json").write_text(json.dumps({"marker": ["cat", "dog", "owl"]}))
    for viewer, answers in {
        "a": ["cat", "dog", "bird"],
        "b": ["a cat", "wolf", "owl"],
        "c": ["fox", "a dog", "?"],
    }.items():
        (tmp_path / f"answers_{viewer}.json").write_text(json.dumps({"marker": answers}))
    blind_naming.score(tmp_path)
    assert json.loads((tmp_path / "scores.json").read_text())["marker"] == {
        "nouns": 3, "by_majority": 2, "by_viewer": [2, 2, 1], "missed": ["owl"],
    }  # fmt: skip


def test_sheet_numbers_drawings_in_rows() -> None:
    drawings = [np.full((64, 64, 3), 10 * number, np.uint8) for number in range(7)]
    picture = blind_naming.sheet(drawings)
    assert picture.shape[0] == 2 * picture.shape[1] / 6 * 230 / 206
    height, width = picture.shape[0] // 2, picture.shape[1] // 6
    assert (picture[height + 100, 100] == 60).all() and (picture[100, 3 * width + 100] == 30).all()
    assert (picture[height + 24 :, width:] == 255).all()  # no seventh row of drawings
