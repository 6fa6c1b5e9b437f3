""" "The house" is the one on the canvas: what is asked for beside it is drawn there, and no second house."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.control.layout import THING, Window, Wish
from pentimento.control.request import understand
from pentimento.control.standing import beside_standing, known_things, sentences, standing_in
from pentimento.control.turn import Turn, write_turn
from pentimento.deploy.words import taught_vocabulary

NAMED = taught_vocabulary("named")
SIDE = 96
HOUSE = Window(0.225, 0.225, 0.45)
"""Where a house stands that was drawn on a blank canvas in turns."""
THERE = {"a house": HOUSE}


def canvas(*windows: Window) -> np.ndarray:
    """White paper with paint in the squares that things fill of windows."""
    picture = np.full((SIDE, SIDE, 3), 250, np.uint8)
    for window in windows:
        picture[replace(window, size=0.8 * window.size).pixels(SIDE)] = 20
    return picture


def placed(words: str, largest: float = 0.45) -> list[Wish]:
    return beside_standing(understand(words, NAMED), canvas(HOUSE), THERE, largest=largest)


def overlap(one: Window, other: Window) -> float:
    """The area that two windows share, in areas of the first."""
    sides = [
        max(0.0, min(a + one.size / 2, b + other.size / 2) - max(a - one.size / 2, b - other.size / 2))
        for a, b in ((one.x, other.x), (one.y, other.y))
    ]
    return sides[0] * sides[1] / one.size**2


@pytest.mark.parametrize("words", ["a tree beside the house", "the house and a tree", "a tree by this cottage"])
def test_tree_beside_the_house_is_drawn_alone_next_to_it(words: str) -> None:
    (tree,) = placed(words)
    assert tree.words == "a tree" and overlap(tree.window, HOUSE) < 0.01
    assert tree.window.x - HOUSE.x == pytest.approx((tree.window.size + HOUSE.size) / 2, abs=0.02)
    assert tree.window.y + tree.window.size / 2 == pytest.approx(HOUSE.y + HOUSE.size / 2, abs=0.02)


@pytest.mark.parametrize(
    ("words", "place"),
    [
        ("a cat to the right of the house", lambda w: w.x > 0.4 and abs(w.y - HOUSE.y) < 0.15),
        ("a cat below the house", lambda w: w.y > 0.4 and abs(w.x - HOUSE.x) < 0.1),
        ("the house above a cat", lambda w: w.y > 0.4 and abs(w.x - HOUSE.x) < 0.1),
        ("a cat in the house", lambda w: w.size < 0.3 and overlap(w, HOUSE) > 0.95),
    ],
)
def test_relations_to_the_house(words: str, place) -> None:
    (cat,) = placed(words)
    assert cat.words == "a cat" and place(cat.window), cat.window


def test_side_with_room_is_taken() -> None:
    middle = Window(0.5, 0.5, 0.3)
    for taken, side in ((0.15, 1), (0.85, -1)):
        sheet = canvas(middle, Window(taken, 0.5, 0.3))
        (tree,) = beside_standing(understand("a tree by the house", NAMED), sheet, {"a house": middle}, largest=0.45)
        assert (tree.window.x - 0.5) * side > 0.2


def test_several_new_things_stand_together() -> None:
    tree, dog = placed("a tree and a dog beside the house", 0.64)
    assert [tree.words, dog.words] == ["a tree", "a dog"]
    assert max(overlap(tree.window, dog.window), overlap(tree.window, HOUSE), overlap(dog.window, HOUSE)) < 1 - THING
    assert tree.window.size == dog.window.size > 0.25


def test_every_place_lies_on_the_canvas() -> None:
    for x in (0.1, 0.5, 0.9):
        for size in (0.2, 0.6, 1.0):
            for words in ("a cat on the house", "a cat to the left of the house", "two cats behind the house"):
                there = {"a house": Window(x, x, size)}
                for wish in beside_standing(understand(words, NAMED), canvas(), there, largest=0.45):
                    w = wish.window
                    assert min(w.x, w.y) - w.size / 2 > -1e-9 and max(w.x, w.y) + w.size / 2 < 1 + 1e-9


def test_a_house_is_a_new_one_and_the_person_is_told_of_the_one_that_stands() -> None:
    assert known_things(understand("a tree beside a house", NAMED), THERE) == []
    assert known_things(understand("a tree beside the cat", NAMED), THERE) == []
    assert sentences(understand("a tree beside the house", NAMED), THERE) == ["the house: the one on the canvas"]
    with pytest.raises(ConfigError, match="The house is on the canvas already"):
        placed("the house")


def test_things_stand_where_the_last_turn_drew_them_if_any_stroke_was_made(tmp_path: Path) -> None:
    two = (Wish("a cat", Window(0.2, 0.2, 0.2)), Wish("a cat", Window(0.4, 0.2, 0.2)))
    write_turn(tmp_path, Turn(0, "a house", 0, 20, (Wish("a house", HOUSE),)))
    write_turn(tmp_path, Turn(1, "two cats", 20, 9, two))
    write_turn(tmp_path, Turn(2, "", 29, 0))
    write_turn(tmp_path, Turn(3, "a dog", 29, 9, (Wish("a dog", HOUSE),)))
    found = standing_in(tmp_path, 29)  # the dog is planned only
    assert found.keys() == {"a house", "a cat"} and found["a house"] == HOUSE
    assert (found["a cat"].x, found["a cat"].size) == pytest.approx((0.3, 0.4))
    assert "a dog" in standing_in(tmp_path, 30) and standing_in(tmp_path / "none", 3) == {}
