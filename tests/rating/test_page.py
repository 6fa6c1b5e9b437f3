"""Blind pages: nothing on them tells a condition, and they agree with their key."""

import base64
from collections import Counter
from itertools import chain

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import decode_png
from pentimento.rating.page import Trial, pages, trials_of
from pentimento.rating.study import SHIPPED, read_study
from tests.rating.raters import FIRST, OTHER, Reader, items, picture, written


def png(source: str) -> bytes:
    return base64.b64decode(source.partition(",")[2])


@pytest.mark.parametrize("study", SHIPPED)
def test_no_condition_and_no_item_is_in_a_pages_bytes(study: str) -> None:
    texts, key = written(study, 6, 3)
    for page, text in texts.items():
        hidden = [text.encode(), *map(png, Reader(text).each("img", "src"))]
        names = [FIRST, OTHER, *items(6)]
        assert not [name for name in names for data in hidden if name.encode() in data]
        assert page in text and "http" not in text and len(key.pages[page]) == text.count("<section")


def test_pictures_stand_where_the_key_says() -> None:
    texts, key = written("text", 20, 2)
    shown = items(20)
    for page, text in texts.items():
        read = Reader(text)
        pictures, trials = read.each("img", "src"), read.each("section", "data-id")
        assert trials == list(key.pages[page])
        for number, trial in enumerate(trials):
            hidden = key.pages[page][trial]
            for place, condition in enumerate(hidden.shown):
                seen = decode_png(png(pictures[2 * number + place]))
                assert np.array_equal(seen, shown[hidden.item][condition])


def test_each_rater_has_an_order_sides_and_ids_of_their_own_by_the_seed() -> None:
    texts, key = written("text", 30, 40)
    parts = [[(hidden.item, hidden.shown) for hidden in page.values()] for page in key.pages.values()]
    orders = {tuple(item for item, _ in page) for page in parts}
    assert len(orders) == 40 and len(set(chain.from_iterable(key.pages.values()))) == 40 * 30
    left = sum(shown[0] == FIRST for page in parts for _, shown in page)
    assert abs(left - 600) < 3 * np.sqrt(1200) / 2  # 1200 fair coins
    assert written("text", 30, 40) == (texts, key) != written("text", 30, 40, seed=1)


def test_trials_are_dealt_evenly_and_no_rater_gets_one_twice() -> None:
    _, key = written("text", 14, 24, conditions=(FIRST, "b", "c"), per_rater=9)
    dealt = [[(hidden.item, *sorted(hidden.shown)) for hidden in page.values()] for page in key.pages.values()]
    assert all(len(set(page)) == 9 for page in dealt)
    counts = Counter(chain.from_iterable(dealt))
    assert len(counts) == 28 and max(counts.values()) - min(counts.values()) <= 1


def test_a_match_asks_of_each_condition_among_all() -> None:
    styles = ("anna", "ben", "cleo")
    texts, key = written("style", 2, 1, conditions=styles)
    (hidden,) = (list(page.values()) for page in key.pages.values())
    assert Counter(one.right for one in hidden) == dict.fromkeys(styles, 2)
    assert all(sorted(one.shown) == sorted(styles) for one in hidden)
    assert len(Reader(*texts.values()).each("img", "src")) == 6 * 4  # the reference, and one of each style


def test_large_pictures_are_scaled_down_and_captions_escaped() -> None:
    study = read_study("text")
    large = Trial("a", {FIRST: picture(0, 0, 1100), OTHER: picture(0, 1)}, "a <cup>")
    text = "".join(pages(study, [large], raters=1, per_rater=None, seed=0)[0].values())
    shapes = {decode_png(png(source)).shape for source in Reader(text).each("img", "src")}
    assert shapes == {(512, 512, 3), (8, 8, 3)} and "a &lt;cup&gt;" in text


def test_a_page_can_be_used_by_keyboard_and_screen_reader() -> None:
    read = Reader(*written("drawings", 1, 1)[0].values())
    assert {attrs["type"] for tag, attrs in read.tags if tag == "input" and "type" in attrs} == {"radio"}
    assert len(read.each("fieldset", "data-question")) == sum(tag == "legend" for tag, _ in read.tags) == 5
    assert all(read.each("img", "alt")) and not read.each("div", "onclick")


def test_a_condition_that_is_called_like_an_answer_is_refused() -> None:
    with pytest.raises(ConfigError, match="'both', which is an answer"):
        trials_of(read_study("text"), items(1, ("both", OTHER)), {"item00": "a cup"})
