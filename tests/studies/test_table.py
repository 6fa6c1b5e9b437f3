"""The blind table goes on where it was interrupted, and makes the same worlds in any order of events."""

import json
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from studies.blind.series import SERIES, Series
from studies.blind.table import code, lines_of, missing

NONE = Series("none", 5, "none")


def test_a_line_that_was_cut_off_is_made_again(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    assert lines_of(path) == []
    whole = json.dumps({"series": "none", "index": 0}) + "\n"
    path.write_text(whole + whole.replace("0", "1")[:-4])
    assert [line["index"] for line in lines_of(path)] == [0]


def test_the_last_line_of_a_world_counts(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    lines = [{"series": "none", "index": 0, "failed": "?"}, {"series": "none", "index": 0, "verdict": {}}]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert lines_of(path) == lines[1:]


def test_what_is_known_is_not_made_again() -> None:
    lines = [{"series": "none", "index": index} for index in (0, 2)] + [{"series": "one cause", "index": 1}]
    assert next(missing(NONE, 3, lines)) == 1
    assert list(missing(NONE, 2, lines)) == []


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_worlds_are_the_first_that_can_be_made_in_whatever_order_they_end(workers: int) -> None:
    rng = np.random.default_rng(workers)
    impossible = {1, 2, 6}
    lines: list[dict[str, object]] = []
    under_way: list[dict[str, object]] = []
    while True:
        for index in islice(missing(NONE, 5, lines), workers - len(under_way)):
            under_way.append({"series": "none", "index": index})
            lines.append(under_way[-1])
        if not under_way:
            break
        ended = under_way.pop(int(rng.integers(len(under_way))))
        if ended["index"] in impossible:
            ended["redrawn"] = "too weak"
    made = {line["index"] for line in lines if "redrawn" not in line}
    assert made == {0, 3, 4, 5, 7}


def test_code_has_a_digest_that_does_not_change_by_itself() -> None:
    assert code() == code() and len(code()) == 12
    assert len({series.name for series in SERIES}) == len(SERIES)
