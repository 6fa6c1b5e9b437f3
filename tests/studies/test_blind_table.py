"""Running the blind benchmark: resumption, seeds, the hash of the truth, and verdicts from a table alone."""

import json
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.contracts.strokes import example_table
from studies.blind.kinds import Kind, kind_of
from studies.blind.one_world import NoVerdict, verdict_by_table
from studies.blind.rivals import METHODS
from studies.blind.series import COLUMNS, STROKES, Series, seed_of, wanted
from studies.blind.table import digest_of_code, missing, read_lines
from studies.blind.truth import Strength, Truth, TruthChanged, read_truth, write_world

NONE = Series("none", 5, "none")
KINDS = pytest.mark.parametrize("kind", [kind_of("strokes"), kind_of("pushes")], ids=lambda kind: kind.name)


def test_line_that_was_cut_off_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    assert read_lines(path) == []
    whole = json.dumps({"series": "none", "index": 0}) + "\n"
    path.write_text(whole + whole.replace("0", "1")[:-4])
    assert [line["index"] for line in read_lines(path)] == [0]


def test_last_line_of_a_world_counts(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    lines = [{"series": "none", "index": 0, "failed": "?"}, {"series": "none", "index": 0, "verdict": {}}]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert read_lines(path) == lines[1:]


def test_known_worlds_are_not_made_again() -> None:
    lines = [{"series": "none", "index": index} for index in (0, 2)] + [{"series": "one cause", "index": 1}]
    assert next(missing(NONE, 3, lines)) == 1
    assert list(missing(NONE, 2, lines)) == []


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_worlds_are_the_first_possible_ones_in_any_order_of_completion(workers: int) -> None:
    rng = np.random.default_rng(workers)
    impossible = {1, 2, 6}
    lines: list[dict[str, object]] = []
    in_progress: list[dict[str, object]] = []
    while True:
        for index in islice(missing(NONE, 5, lines), workers - len(in_progress)):
            in_progress.append({"series": "none", "index": index})
            lines.append(in_progress[-1])
        if not in_progress:
            break
        ended = in_progress.pop(int(rng.integers(len(in_progress))))
        if ended["index"] in impossible:
            ended["redrawn"] = "too weak"
    made = {line["index"] for line in lines if "redrawn" not in line}
    assert made == {0, 3, 4, 5, 7}


def test_digest_of_code_is_reproducible() -> None:
    assert digest_of_code() == digest_of_code() and len(digest_of_code()) == 12


@KINDS
def test_seeds_differ_by_commit_series_and_index_and_are_reproducible(kind: Kind) -> None:
    seeds = [seed_of(c, kind.seed_prefix + s.name, k) for c in ("abc", "abd") for s in kind.series for k in range(30)]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**31 for seed in seeds)
    assert seed_of("abc", "none", 3) == 297054552


@KINDS
def test_every_series_can_be_drawn(kind: Kind) -> None:
    for series in kind.series:
        for cause in series.causes or (None,):
            sketch = kind.sketch(series.stratum, 5, cause, series.q)
            assert sketch.stratum == series.stratum
            assert cause is None or (sketch.causes == (cause,) and cause in COLUMNS)
            assert series.q is None or set(sketch.q) == {series.q}


def test_share_of_the_benchmark_has_a_world_of_each_series() -> None:
    assert [wanted(s, 1.0) for s in STROKES] == [s.worlds for s in STROKES]
    assert all(1 <= wanted(s, 0.01) <= wanted(s, 0.5) < s.worlds for s in STROKES)


def test_truth_is_written_with_its_hash_and_a_changed_truth_is_refused(tmp_path: Path) -> None:
    truth = Truth("one", 3, "marker", ("latency",), None, (0.2,), (Strength(0.4, 0.21, 0.02),), False)
    write_world(tmp_path, pa.table({"order": [1]}), truth)
    sha256 = (tmp_path / "truth.sha256").read_text().strip()
    written = read_truth(tmp_path / "truth.json", sha256)
    assert written["strengths"] == [{"strength": 0.4, "q": 0.21, "q_se": 0.02}]
    (tmp_path / "truth.json").write_text('{"causes": ["backlash"]}\n')
    with pytest.raises(TruthChanged, match="changed after its hash was published"):
        read_truth(tmp_path / "truth.json", sha256)


def test_verdict_needs_the_table_alone(tmp_path: Path) -> None:
    pq.write_table(example_table(56), tmp_path / "table.parquet")
    result = verdict_by_table(tmp_path / "table.parquet", module=kind_of("strokes").verdict_module)
    assert result["verdict"]["rows"] == 56 and result["verdict"]["schema"] == 2
    assert result["seconds"] > 0 and set(result["rivals"]) == set(METHODS)


def test_failed_diagnosis_reports_its_error(tmp_path: Path) -> None:
    pq.write_table(example_table(4), tmp_path / "table.parquet")
    with pytest.raises(NoVerdict, match="takes at least 15"):
        verdict_by_table(tmp_path / "table.parquet", module=kind_of("strokes").verdict_module)
