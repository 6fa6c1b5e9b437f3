"""The tokenizer gives the ids of transformers' CLIPTokenizer."""

import random
import unicodedata
from pathlib import Path

import pytest
from transformers import CLIPTokenizer

from pentimento.bundle.tokenizer import Tokenizer, read_tokenizer
from pentimento.contracts.errors import ContractError
from pentimento.semantics.tokenizer import learn_tokenizer

LENGTH = 24
CAPTIONS = ["a cat beside a tree", "two houses and a boat", "a bird's nest in the 3rd tree", "a café by the sea"]
CASES = [
    "",
    "   ",
    "  A  CAT's 12 things, isn't it?! ",
    "<|endoftext|> x",
    "x<|StartOfText|>!!<|startoftext|>",
    "ΣΑΣ final, İstanbul",
    "naïve café e\u0301",
    "日本語 42²Ⅷ",
    "\x1c\x1d a\u00a0b\u2003c\u200bd",
    "_under_score ''s 'tis we'll DON'T",
    "👩‍🎨 paints 🎨🎨",
    "a very long caption " * 20,
    "w" * 300,
]


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[CLIPTokenizer, Tokenizer]:
    folder = tmp_path_factory.mktemp("tokenizer")
    theirs = learn_tokenizer(CAPTIONS * 3, 60, LENGTH)
    theirs.backend_tokenizer.model.save(str(folder))
    return theirs, read_tokenizer(folder / "vocab.json", folder / "merges.txt", LENGTH)


def _theirs(tokenizer: CLIPTokenizer, captions: list[str]) -> list[list[int]]:
    return tokenizer(captions, padding="max_length", max_length=LENGTH, truncation=True)["input_ids"]


@pytest.mark.parametrize("caption", [*CAPTIONS, *CASES])
def test_tokenizer_ids_equal_transformers_for_difficult_captions(
    both: tuple[CLIPTokenizer, Tokenizer], caption: str
) -> None:
    assert both[1].encode([caption]).tolist() == _theirs(both[0], [caption])


def test_tokenizer_ids_equal_transformers_for_random_texts(both: tuple[CLIPTokenizer, Tokenizer]) -> None:
    chance = random.Random(0)
    # Letters of this Python's Unicode version; a newer version may classify other characters as letters.
    known = [chr(code) for code in range(0x20, 0x2FFFF) if unicodedata.category(chr(code)) not in ("Cn", "Cs", "Co")]
    plain = [chr(code) for code in range(32, 127)]
    texts = [
        "".join(chance.choice(plain if chance.random() < 0.6 else known) for _ in range(chance.randrange(40)))
        for _ in range(1000)
    ]
    assert both[1].encode(texts).tolist() == _theirs(both[0], texts)


def test_tokenizer_rejects_invalid_files(tmp_path: Path) -> None:
    (tmp_path / "vocab.json").write_text('{"a": 0}')
    (tmp_path / "merges.txt").write_text("#version: 0.2\na b\n")
    with pytest.raises(ContractError, match="startoftext"):
        read_tokenizer(tmp_path / "vocab.json", tmp_path / "merges.txt", LENGTH)
    (tmp_path / "vocab.json").write_text('{"<|startoftext|>": 0, "<|endoftext|>": 1}')
    (tmp_path / "merges.txt").write_text("a b c\n")
    with pytest.raises(ContractError, match="pair"):
        read_tokenizer(tmp_path / "vocab.json", tmp_path / "merges.txt", LENGTH)
    with pytest.raises(ContractError, match="cannot be read"):
        read_tokenizer(tmp_path / "nowhere.json", tmp_path / "merges.txt", LENGTH)
