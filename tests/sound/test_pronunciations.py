"""Words are pronounced by the dictionary, and by rules for plurals and compounds."""

from __future__ import annotations

from pathlib import Path

import pytest

from pentimento.sound.pronunciations import pronounced, read_dictionary

DICTIONARY = {
    "a": ("AH", "EY"), "cat": ("K AE T",), "dog": ("D AO G",), "bus": ("B AH S",), "peach": ("P IY CH",),
    "berry": ("B EH R IY",), "paper": ("P EY P ER",), "clip": ("K L IH P",), "light": ("L AY T",),
}  # fmt: skip


@pytest.mark.parametrize(
    ("word", "phones"),
    [
        ("a", ("AH", "EY")),
        ("cats", ("K AE T S",)),
        ("dogs", ("D AO G Z",)),
        ("buses", ("B AH S IH Z",)),
        ("peaches", ("P IY CH IH Z",)),
        ("berries", ("B EH R IY Z",)),
        ("paperclip", ("P EY P ER K L IH P",)),
        ("paperclips", ("P EY P ER K L IH P S",)),
        ("cat light", ("K AE T L AY T",)),
        ("cat-light", ("K AE T L AY T",)),
    ],
)
def test_pronunciation(word: str, phones: tuple[str, ...]) -> None:
    assert pronounced([word], DICTIONARY) == {word: phones}


def test_words_that_nothing_knows_are_missing() -> None:
    assert pronounced(["zebra", "cat zebra", "catdog", "", "caty"], DICTIONARY) == {"catdog": ("K AE T D AO G",)}


def test_dictionary_lists_further_pronunciations_in_brackets(tmp_path: Path) -> None:
    file = tmp_path / "words.dict"
    file.write_text("a AH\na(2) EY\ncat K AE T\n")
    assert read_dictionary(file) == {"a": ("AH", "EY"), "cat": ("K AE T",)}
