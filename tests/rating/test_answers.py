"""Files of answers: read with what their page hid, or refused in a sentence."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest

from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ContractError
from pentimento.rating.answers import COLUMNS, read_answers, read_key, table
from tests.rating.raters import FIRST, OTHER, save, written

_, KEY = written("text", 3, 2)
PAGE, PARTS = next(iter(KEY.pages.items()))
TRIAL = next(iter(PARTS))
GOOD: dict[str, Any] = {"page": PAGE, "rater": "n", "comment": "", "answers": {TRIAL: {"text": "1"}}}


def test_sides_become_conditions_and_the_table_has_a_row_for_each_answer(tmp_path: Path) -> None:
    (tmp_path / "key.json").write_text(json.dumps(to_plain(KEY)))
    key = read_key(tmp_path / "key.json")
    assert key == KEY
    answers = read_answers(save(tmp_path, key, lambda hidden: str(1 + hidden.shown.index(OTHER))), key)
    assert len(answers) == 6 and {answer.value for answer in answers} == {OTHER}
    ties = read_answers(save(tmp_path, key, lambda hidden: "neither"), key)
    assert {answer.value for answer in ties} == {"neither"}
    rows = list(csv.DictReader(io.StringIO(table(answers))))
    assert tuple(rows[0]) == COLUMNS and len(rows) == 6
    assert {row["answer"] for row in rows} == {OTHER} and rows[0]["shown"] in (
        f"{FIRST} | {OTHER}",
        f"{OTHER} | {FIRST}",
    )


@pytest.mark.parametrize(
    ("saved", "sentence"),
    [
        ("{", "no file of answers"),
        ("[" * 100_000, "no file of answers"),
        (GOOD | {"page": "other"}, "not in this key"),
        (GOOD | {"rater": "  "}, "no rater's name"),
        (GOOD | {"answers": {"zz": {"text": "1"}}}, "does not have"),
        (GOOD | {"answers": {TRIAL: {"text": "3"}}}, "does not offer"),
        (GOOD | {"answers": {TRIAL: {"taste": "1"}}}, "does not offer"),
        (GOOD | {"answers": {TRIAL: "1"}}, "answers"),
        ({"page": PAGE, "rater": "n"}, "missing"),
        ([1], "mapping"),
    ],
)
def test_a_broken_file_is_refused_in_a_sentence(tmp_path: Path, saved: object, sentence: str) -> None:
    path = tmp_path / "answers.json"
    path.write_text(saved if isinstance(saved, str) else json.dumps(saved))
    with pytest.raises(ContractError, match=sentence) as refused:
        read_answers([path], KEY)
    assert "answers.json" in str(refused.value)


def test_a_second_file_of_a_rater_and_a_wrong_key_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "answers.json"
    path.write_text(json.dumps(GOOD))
    with pytest.raises(ContractError, match="both of 'n'"):
        read_answers([path, path], KEY)
    with pytest.raises(ContractError, match=r"answers\.json"):
        read_key(path)
