"""Each word of the shipped vocabulary reaches its noun, and no word is grammar."""

import json
from functools import cache
from importlib.resources import files

import pytest

from pentimento.bundle.vocabulary import Vocabulary, read_vocabulary
from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.requests import MARKER_WORDS
from pentimento.control.request import EXAMPLES, understand
from pentimento.control.request_items import Named, nouns_by_word, scan
from pentimento.copainting.drawings.scenes import plural
from pentimento.copainting.drawings.sources import vocabulary
from pentimento.copainting.scenes.things import KINDS
from pentimento.deploy.words import taught_vocabulary


@cache
def taught() -> Vocabulary:
    return taught_vocabulary("named")


def test_each_taught_word_and_its_plural_is_one_noun() -> None:
    nouns = nouns_by_word(taught())
    for name, noun in vocabulary().items():
        for word in (name, *noun.synonyms):
            for form in (word, plural(word), word.upper(), word.replace(" ", "-")):
                (item,) = scan(form, nouns)
                assert isinstance(item, Named) and item.is_taught and item.noun == name, form


def test_each_nearest_word_reaches_its_noun_and_is_no_grammar() -> None:
    nouns = nouns_by_word(taught())
    for name, noun in taught().nouns.items():
        for word in noun.nearest:
            (item,) = scan(word, nouns)
            assert isinstance(item, Named) and item.noun == name, word


def test_requests_of_a_single_noun_are_its_caption() -> None:
    for noun in list(taught().nouns.values())[::12]:
        understood = understand(noun.one, taught())
        assert understood.text == noun.one and not understood.messages()


@pytest.mark.parametrize(
    ("word", "noun"),
    [
        ("poodle", "dog"), ("oak tree", "tree"), ("sparrow", "bird"), ("sedan", "car"), ("lynx", "cat"),
        ("tuna", "fish"), ("espresso", "coffee cup"), ("laptop", "desktop computer"), ("stallion", "horse"),
        ("tulip tree", "tree"), ("cobra", "snake"), ("beret", "cap"), ("kayak", "sailboat"), ("clock", "watch"),
        ("hen", "rooster"), ("cottage", "house"), ("champagne", "wine glass"), ("auto", "car"),
    ],
)  # fmt: skip
def test_kinds_of_things_are_drawn_as_the_thing(word: str, noun: str) -> None:
    understood = understand(f"the {word}", taught())
    assert understood.text == taught().nouns[noun].one
    assert understood.messages() == [f"{'an' if word[0] in 'aeiou' else 'a'} {word}: drawn as {understood.text}"]


@pytest.mark.parametrize("word", ["table", "king", "sunset", "sheep", "love", "mat", "red", "city", "computation"])
def test_other_words_are_no_kind_of_a_thing(word: str) -> None:
    assert not any(isinstance(item, Named) for item in scan(word, nouns_by_word(taught())))


def test_examples_are_understood_as_they_are() -> None:
    for example in EXAMPLES:
        assert understand(example, taught()).text == example
        assert not understand(example, taught()).messages()
    assert understand(f"a cat {MARKER_WORDS}", taught()).text == "a cat"


def test_vocabulary_is_small_survives_storage_and_names_its_licence() -> None:
    data = json.dumps(to_plain(taught())).encode()
    assert len(data) < 200_000
    assert read_vocabulary(data, "nouns.json") == taught()
    assert "WordNet 3.0 Copyright 2006 by Princeton University" in taught().notice
    table = files("pentimento.copainting.drawings").joinpath("nearest_words.txt")
    assert len(table.read_bytes()) < 200_000


def test_synthetic_things_are_reached_by_what_was_not_taught() -> None:
    vocabulary = taught_vocabulary("synthetic")
    assert set(vocabulary.nouns) == set(KINDS)
    assert all(noun.words == (name,) for name, noun in vocabulary.nouns.items())
    asked = {"a kitten": "a cat", "an oak": "a tree", "two boats": "two boats", "a clock": "a clock"}
    assert {words: understand(words, vocabulary).text for words in asked} == asked
    with pytest.raises(ConfigError):
        understand("a saxophone", vocabulary)
