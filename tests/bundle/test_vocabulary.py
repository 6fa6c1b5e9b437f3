"""The nouns of a bundle are read strictly."""

import json
from typing import Any

import pytest

from pentimento.bundle.vocabulary import Noun, Vocabulary, read_vocabulary
from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ConfigError

CAT = Noun("a cat", "cats", ("cat", "kitten"), ("cats", "kittens"), ("tabby",))
PLAIN: dict[str, Any] = to_plain(Vocabulary("by hand", False, {"cat": CAT}))


def test_vocabulary_round_trip() -> None:
    assert read_vocabulary(json.dumps(PLAIN).encode(), "nouns.json") == Vocabulary("by hand", False, {"cat": CAT})


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        ([], "nouns.json"),
        ({"nouns": {}}, "missing keys"),
        ({"notice": "", "by_window": True, "nouns": {}}, "no nouns"),
        (PLAIN | {"more": 1}, "unknown keys"),
        (PLAIN | {"nouns": {"cat": to_plain(CAT) | {"words": "cat"}}}, "a list"),
        (PLAIN | {"nouns": {"cat": to_plain(CAT) | {"one": 1}}}, "a text"),
        (PLAIN | {"nouns": {"cat": to_plain(CAT), "dog": to_plain(CAT)}}, "'cat' stands there twice"),
    ],
)
def test_read_vocabulary_rejects_another_shape(plain: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_vocabulary(json.dumps(plain).encode(), "nouns.json")


@pytest.mark.parametrize("data", [b"", b"{", b"\xff\xfe", b"[" * 100_000])
def test_read_vocabulary_rejects_what_is_no_json(data: bytes) -> None:
    with pytest.raises(ConfigError, match="stage deploy"):
        read_vocabulary(data, "nouns.json")
