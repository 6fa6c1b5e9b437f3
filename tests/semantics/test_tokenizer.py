"""The learned tokenizer: known words, other texts by bytes, and its files."""

from pathlib import Path

from transformers import CLIPTokenizer

from pentimento.semantics.tokenizer import END, START, learn_tokenizer

CAPTIONS = ["a red house beside a tree", "a blue house under a cloud"] * 5


def test_tokenizer_encodes_known_words_as_one_token() -> None:
    tokenizer = learn_tokenizer(CAPTIONS, 200, 16)
    assert len(tokenizer("a red house beside a tree")["input_ids"]) == 6 + 2
    assert len(tokenizer("a zebra")["input_ids"]) > 4


def test_tokenizer_round_trips_any_language_and_truncates() -> None:
    tokenizer = learn_tokenizer(CAPTIONS, 200, 64)
    for text in ("猫が月の下に", "été à la mer", "a 😀 house"):
        ids = tokenizer(text)["input_ids"]
        assert tokenizer.unk_token_id not in ids[1:-1]
        assert tokenizer.decode(ids, skip_special_tokens=True).strip() == text
    cut = tokenizer("house " * 500, truncation=True, max_length=64)["input_ids"]
    assert len(cut) == 64 and cut[-1] == tokenizer.eos_token_id


def test_tokenizer_is_deterministic_and_survives_saving(tmp_path: Path) -> None:
    one, other = learn_tokenizer(CAPTIONS, 50, 16), learn_tokenizer(CAPTIONS, 50, 16)
    assert one.get_vocab() == other.get_vocab()
    one.save_pretrained(tmp_path)
    back = CLIPTokenizer.from_pretrained(tmp_path, local_files_only=True)
    text = "a red house beside a cloud, maybe"
    assert back(text)["input_ids"] == one(text)["input_ids"]
    assert (back.bos_token, back.eos_token) == (START, END) and back.model_max_length == 16
