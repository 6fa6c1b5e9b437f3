"""The blind preference page, its key, and the test of the answers."""

import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.copainting.evaluation.preferences import Comparison, preference_page, preferences, read_answers

LIGHT, DARK = np.full((8, 8, 3), 200, np.uint8), np.full((8, 8, 3), 20, np.uint8)
KEY = {f"p{i}": {"left": "ours", "right": "base"} for i in range(8)} | {"q": {"left": "text_only", "right": "ours"}}


class Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def page_of(count: int, seed: int = 0) -> tuple[str, dict[str, dict[str, str]]]:
    return preference_page([Comparison(f"a <cup> {i}", LIGHT, DARK, "base") for i in range(count)], seed)


def test_preference_page_is_blind_and_agrees_with_its_key() -> None:
    page, key = page_of(40)
    reader = Reader()
    reader.feed(page)
    pictures = [attrs["src"] for tag, attrs in reader.tags if tag == "img"]
    names = [attrs["data-id"] for tag, attrs in reader.tags if tag == "fieldset"]
    assert len(names) == len(set(names)) == 40 and set(names) == set(key)
    ours = {pictures[2 * i + (key[str(name)]["right"] == "ours")] for i, name in enumerate(names)}
    assert len(ours) == 1  # one and the same picture: ours stands where the key says
    assert 8 < sum(sides["left"] == "ours" for sides in key.values()) < 32  # on both sides
    assert "ours" not in page and "base" not in page.replace("base64", "")
    assert "a &lt;cup&gt; 3" in page and "http" not in page
    assert page_of(40) == (page, key) and page_of(40, 1)[1] != key


def saved(folder: Path, person: str, answers: dict[str, str]) -> Path:
    path = folder / f"{person}.json"
    path.write_text(json.dumps({"participant": person, "answers": answers}))
    return path


def test_preferences_count_answers_and_decide_pairs_by_majority(tmp_path: Path) -> None:
    everyone = [saved(tmp_path, f"n{n}", {f"p{i}": "left" for i in range(8)} | {"q": "both"}) for n in range(2)]
    everyone.append(saved(tmp_path, "other", {"p0": "right", "p1": "neither", "q": "right"}))
    found = preferences(read_answers(everyone, KEY), KEY)
    base = found["base"]
    assert base.answers == {"ours": 16, "rival": 1, "both": 0, "neither": 1}
    assert (base.people, base.pairs_ours, base.pairs_rival, base.share) == (3, 8, 0, 1.0)
    assert base.p == pytest.approx(2 * 0.5**8)  # eight heads of eight, either way
    assert base.interval is not None and base.interval[0] == pytest.approx(0.025 ** (1 / 8))
    assert found["text_only"].pairs_ours == 1 and found["text_only"].p == pytest.approx(1.0)


def test_preference_share_is_none_without_decided_pairs() -> None:
    undecided = preferences({"n": {"p0": "both"}}, KEY)["base"]
    assert undecided.share is None and undecided.p is None and undecided.answers["both"] == 1


@pytest.mark.parametrize(
    ("answers", "sentence"),
    [({"zz": "left"}, "not in the key"), ({"p0": "up"}, "not a choice")],
)
def test_rejects_answers_of_another_page(tmp_path: Path, answers: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ContractError, match=sentence):
        read_answers([saved(tmp_path, "n", answers)], KEY)


def test_rejects_second_file_of_a_person_and_broken_json(tmp_path: Path) -> None:
    path = saved(tmp_path, "n", {"p0": "left"})
    with pytest.raises(ContractError, match="second file of"):
        read_answers([path, path], KEY)
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(ContractError, match="save it from the page again"):
        read_answers([tmp_path / "broken.json"], KEY)
