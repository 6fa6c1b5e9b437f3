"""A person's request is put into the words that the goal planner was taught, or refused with a sentence."""

import string
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError
from pentimento.control.request import Understood, understand
from pentimento.deploy.words import taught_vocabulary


@cache
def taught() -> Vocabulary:
    return taught_vocabulary("named")


def understood(words: str) -> Understood:
    return understand(words, taught())


def refusal(words: str) -> str:
    with pytest.raises(ConfigError) as error:
        understood(words)
    assert "Nothing was painted." in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("a cat", "a cat"),
        ("cat", "a cat"),
        ("Just a CAT.", "a cat"),
        ("the cat", "a cat"),
        ("an apple", "an apple"),
        ("a kitten beside a tree", "a cat beside a tree"),
        ("a hot dog next to a traffic light", "a hot dog next to a traffic light"),
        ("a teddy-bear and a T-shirt", "a teddy bear and a t-shirt"),
        ("four-leaf clover", "a clover"),
        ("please draw me a picture of two cats on a chair", "two cats on a chair"),
        ("I'd like a horse!", "a horse"),
        ("can you paint a sun over a house", "a sun over a house"),
        ("3 fish", "three fish"),
        ("a pair of shoes", "two shoes"),
        ("a pair of scissors", "scissors"),
        ("a bird between a house and a tree", "a bird between a house and a tree"),
        ("a cat, a dog and a tree in a row", "a cat, a dog and a tree in a row"),
        ("a cat and a dog side by side", "a cat and a dog side by side"),
        ("a cat, a dog, a tree and a sun", "a cat, a dog, a tree and a sun"),
        ("a cat, a dog, a tree", "a cat, a dog and a tree"),
        ("a snowman with a carrot and a hat", "a snowman, a carrot and a hat"),
        ("a cat and a dog above a tree and a sun", "a cat and a dog above a tree and a sun"),
        ("a tree with a bird above it", "a tree with a bird above it"),
        ("a bucket with an apple in it", "a bucket with an apple in it"),
        ("a house with a tree beside it", "a tree beside a house"),
        ("a house near a tree", "a house beside a tree"),
        ("a cat underneath a chair", "a cat under a chair"),
        ("there is a ghost in the castle", "a ghost in a castle"),
        ("a cat on a chair in colours", "a cat on a chair"),
    ],
)
def test_taught_words_pass_in_the_taught_form_without_a_message(words: str, text: str) -> None:
    found = understood(words)
    assert (found.text, found.messages()) == (text, [])


LINKS = (
    "beside", "next to", "to the left of", "to the right of", "above", "over", "below", "under", "on", "on top of",
    "behind", "in front of", "before", "inside", "in", "and",
)  # fmt: skip


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_order_of_things_and_relations_is_kept(data: st.DataObject) -> None:
    nouns = list(taught().nouns.values())
    first, second = (data.draw(st.sampled_from(nouns)) for _ in range(2))
    link = data.draw(st.sampled_from(LINKS))
    count = data.draw(st.sampled_from(("two", "three")))
    words = f"{first.one} {link} {count} {second.many}"
    found = understood(words)
    assert (found.text, found.messages()) == (words, [])
    assert [(thing.words, thing.number, thing.link) for thing in found.things] == [
        (first.one, 1, None), (second.one, {"two": 2, "three": 3}[count], link),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "text", "messages"),
    [
        ("a poodle", "a dog", ["a poodle: drawn as a dog"]),
        ("three poodles", "three dogs", ["three poodles: drawn as three dogs"]),
        ("poodles", "two dogs", ["poodles: drawn as two dogs"]),
        ("cats", "two cats", ["cats: drawn as two cats"]),
        ("an oak tree behind a sedan", "a tree behind a car",
         ["an oak tree: drawn as a tree", "a sedan: drawn as a car"]),
        ("a small red cat, please", "a cat", ["not understood and left out: small, red"]),
        ("a big dog sleeping on a red couch", "a dog on a couch", ["not understood and left out: big, sleeping, red"]),
        ("a cat wearing a hat", "a cat and a hat", ["not understood and left out: wearing"]),
        ("cat chasing mouse", "a cat and a mouse", ["not understood and left out: chasing"]),
        ("a lemon hat", "a hat", ["not understood and left out: lemon"]),
        ("a bowl of apples", "two apples",
         ["apples: drawn as two apples", "not understood and left out: bowl"]),
        ("a bottle of milk", "a bottle", ["not understood and left out: milk"]),
        ("a cat on", "a cat", ["not understood and left out: on"]),
    ],
)  # fmt: skip
def test_what_is_drawn_otherwise_or_left_out_is_told(words: str, text: str, messages: list[str]) -> None:
    assert (understood(words).text, understood(words).messages()) == (text, messages)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("florb gnarx", "florb gnarx"),
        ("a cat and a florb", "florb"),
        ("a florb a cat", "florb"),
        ("a cat florb a dog", "florb"),
        ("a dog park", "park"),
        ("a cat or a dog", "or"),
        ("a cat on it", "it"),
        ("it", "it"),
        ("the", "the"),
        ("a beautiful silence", "beautiful silence"),
        ("un chat à côté d'un arbre", "un chat à côté d'un arbre"),
        ("die Katze neben dem Baum", "katze neben dem baum"),
        ("une rose et un lion", "une"),
        ("el gato en la casa", "el gato en la casa"),
        ("кот под деревом", "кот под деревом"),
        ("木の横の猫", "木の横の猫"),
        ("🐈", "🐈"),
        ("a cat without a hat", "without"),
        ("no cats", "no"),
        ("<script>", "script"),
    ],
)
def test_what_is_not_understood_is_named_with_examples(words: str, named: str) -> None:
    message = refusal(words)
    assert f'"{named}" is not understood' in message and message.count('"a cat beside a tree"') == 1


def test_nearest_spelling_is_suggested() -> None:
    assert 'did you mean "cat"?' in refusal("a caat")
    assert 'did you mean "elephant" or "umbrella"?' in refusal("elefant umbrela")
    assert "did you mean" not in refusal("xqzw")


@pytest.mark.parametrize(
    "words",
    [
        "five cats", "5 cats", "99999999999 cats", "a dozen eggs", "twenty two cats", "a hundred trees",
        "two cats and three dogs", "a cat, a dog, a tree, a house and a sun",
    ],
)  # fmt: skip
def test_more_than_four_things_are_refused(words: str) -> None:
    assert "up to four" in refusal(words) and "is not understood" not in refusal(words)


@pytest.mark.parametrize("vocabulary", [None, taught_vocabulary("named")])
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "empty"),
        (" \u00a0 ", "empty"),
        ("a cat " * 334, "2004 characters"),
        ("a cat\n", "U+000A"),
        ("a \x1b[31mcat", "U+001B"),
        ("a \u202ecat", "U+202E"),
        ("a c\u200bat", "U+200B"),
        ("\ufeffa cat", "U+FEFF"),
        ("a cat \u3164", "U+3164"),
        ("a cat\ufe0f", "U+FE0F"),
    ],
)
def test_empty_long_and_invisible_requests_are_refused_whatever_the_planner_knows(
    vocabulary: Vocabulary | None, words: str, message: str
) -> None:
    with pytest.raises(ConfigError) as error:
        understand(words, vocabulary)
    assert message in str(error.value) and "Nothing was painted." in str(error.value)


def test_without_a_vocabulary_requests_pass_unchanged() -> None:
    words = "Un château à la mer, style Monet"
    assert understand(words, None) == Understood(words)


@given(st.text(max_size=60) | st.text(string.ascii_lowercase + " ,.'-", max_size=60))
@settings(max_examples=60, deadline=None)
def test_any_text_is_understood_or_refused(words: str) -> None:
    try:
        text = understood(words).text
    except ConfigError as error:
        assert "Nothing was painted." in str(error)
    else:
        again = understood(text)  # taught words stay as they are
        assert (again.text, again.messages()) == (text, [])
