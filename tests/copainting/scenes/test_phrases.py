"""Words for things."""

from pentimento.contracts.scenes import listed, phrase
from pentimento.copainting.scenes.things import KINDS


def test_phrase_has_the_right_article() -> None:
    assert phrase("apple") == "an apple" and phrase("apple", "red") == "a red apple"
    assert phrase("cup", "orange") == "an orange cup"
    assert all(phrase(kind).startswith("an ") == (kind[0] in "aeiou") for kind in KINDS)


def test_listed_keeps_order_and_punctuation() -> None:
    for words in (["a cup"], ["a cup", "a sun"], ["a cup", "a sun", "a tree"]):
        said = listed(words)
        assert said.count(" and ") == (len(words) > 1) and said.count(",") == max(0, len(words) - 2)
        places = [said.index(word) for word in words]
        assert places == sorted(places)
