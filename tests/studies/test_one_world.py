"""A world is judged by its table alone, and its truth is opened only if it is the sealed one."""

import hashlib
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pentimento.contracts.strokes import example_table
from studies.blind.one_world import NoVerdict, SealError, opened, verdict_by_table


def test_a_changed_truth_is_not_opened(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    path.write_text('{"causes": ["latency"]}\n')
    seal = hashlib.sha256(path.read_bytes()).hexdigest()
    assert opened(path, seal) == {"causes": ["latency"]}
    path.write_text('{"causes": ["backlash"]}\n')
    with pytest.raises(SealError, match="not what was sealed"):
        opened(path, seal)


def test_a_table_alone_is_enough_for_a_verdict(tmp_path: Path) -> None:
    pq.write_table(example_table(56), tmp_path / "table.parquet")
    said = verdict_by_table(tmp_path / "table.parquet")
    assert said["verdict"]["rows"] == 56 and said["verdict"]["schema"] == 1
    assert said["seconds"] > 0 and isinstance(said["pixelwise"], list)


def test_a_table_that_allows_none_says_why(tmp_path: Path) -> None:
    pq.write_table(example_table(4), tmp_path / "table.parquet")
    with pytest.raises(NoVerdict, match="takes at least 12"):
        verdict_by_table(tmp_path / "table.parquet")
