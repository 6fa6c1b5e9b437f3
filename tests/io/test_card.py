"""Tests of data cards and their warnings."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.cli.main import main
from pentimento.contracts import pushes, strokes
from pentimento.contracts.images import read_image
from pentimento.io.card import write_card
from pentimento.io.table_checks import confounded_with_time, drift, imbalance, rank_correlation, too_little

ROWS = np.arange(40)


def carded(table: pa.Table, folder: Path) -> tuple[str, list[str]]:
    pq.write_table(table, folder / "rows.parquet")
    place, warnings = write_card(folder / "rows.parquet", None)
    assert place == folder / "rows.card.md"
    return place.read_text(), warnings


def test_card_counts_rows_and_lists_unobservable_causes(tmp_path: Path) -> None:
    table = strokes.example_table(24)
    bad = table.to_pylist()
    bad[3]["after"]["bytes"] = b"torn"
    text, warnings = carded(pa.Table.from_pylist(bad, schema=table.schema), tmp_path)
    assert "23 strokes of round_brush" in text and "1 rows quarantined" in text
    assert "`wet_mixing`: no stroke is known to cross paint" in text and "Not recorded: `wet_age_s`" in text
    assert any(line.startswith("Row 3 breaks the contract") for line in warnings)
    assert any("go one way" in line for line in warnings)  # all of them are drawn to the right
    assert any(line.startswith("Aliasing: ") for line in warnings)
    assert all(f"- {line}" in text for line in warnings)


def test_card_of_pushes_and_pinches_is_written(tmp_path: Path) -> None:
    rows = pushes.example_table(12).to_pylist()
    for kinds, unseen in ((rows[:3], False), (rows, True)):
        for row in kinds:
            row["kind"] = "pinch"
        file = tmp_path / f"rows_{len(kinds)}.parquet"
        pq.write_table(pa.Table.from_pylist(rows, schema=pushes.example_table(1).schema), file)
        text = write_card(file, None)[0].read_text()
        assert "12 pushes of ball" in text
        assert ("all rows are pinches" in text) is unseen


def test_card_of_pushes_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pq.write_table(pushes.example_table(12), tmp_path / "rows.parquet")
    assert main(["card", str(tmp_path / "rows.parquet"), "--out", str(tmp_path / "said.md")]) == 0
    assert "12 rows are few" in capsys.readouterr().out
    text = (tmp_path / "said.md").read_text()
    assert "12 pushes of ball" in text and "`adhesion_lift`" in text and "depth (mm)" in text


def test_a_table_needs_no_import_and_its_first_strokes_are_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = tmp_path / "rows.parquet"
    pq.write_table(strokes.example_table(12), rows)
    assert main(["import", str(rows), "--out", str(tmp_path / "out")]) == 1
    assert "is a table already" in capsys.readouterr().err
    assert main(["card", str(rows), "--sheet", str(tmp_path / "sheet.png")]) == 0
    drawn = read_image(tmp_path / "sheet.png").reshape(-1, 3)
    assert (drawn == (20, 150, 60)).all(1).any(), "the dot at a path's start"


def test_card_of_one_stroke_names_what_it_cannot_show(tmp_path: Path) -> None:
    one = strokes.example_table(1)
    for table, reason in ((one, "all strokes lie at one place"), (pa.concat_tables([one, one]), "canvas are unknown")):
        text, warnings = carded(table, tmp_path)
        assert f"{table.num_rows} rows are few" in " ".join(warnings)
        (line,) = (line for line in text.splitlines() if line.startswith("- `canvas_tilt`"))
        assert reason in line
    pq.write_table(pushes.example_table(1), tmp_path / "push.parquet")
    assert any("1 rows are few" in line for line in write_card(tmp_path / "push.parquet", None)[1])


def test_a_card_replaces_only_a_card(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pq.write_table(pushes.example_table(3), tmp_path / "rows.parquet")
    (tmp_path / "notes.md").write_text("mine")
    given = ["card", str(tmp_path / "rows.parquet"), "--out"]
    assert main([*given, str(tmp_path / "notes.md")]) == 1 and main([*given, str(tmp_path)]) == 1
    assert "is no data card, and would be replaced" in capsys.readouterr().err
    assert (tmp_path / "notes.md").read_text() == "mine"
    assert main([*given, str(tmp_path / "card.md")]) == 0 and main([*given, str(tmp_path / "card.md")]) == 0


def test_card_names_an_unreadable_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["card", str(tmp_path / "nowhere.parquet")]) == 1
    assert "nowhere.parquet" in capsys.readouterr().err


def test_warns_of_drift_when_paper_darkens_but_not_of_noise() -> None:
    rng = np.random.default_rng(0)
    darker = 0.95 - 0.1 * ROWS / 40 + rng.normal(0, 0.005, 40)
    (said,) = drift({"paper lightness": darker}, [ROWS])
    assert "goes down" in said
    assert drift({"paper lightness": 0.95 + rng.normal(0, 0.005, 40)}, [ROWS]) == []
    assert drift({"paper lightness": darker}, [rng.permutation(40)]) == []  # another order of execution


def test_warns_of_press_confounded_with_the_order() -> None:
    (said,) = confounded_with_time({"press (mm)": ROWS * 0.1, "length (mm)": np.tile([1.0, 2.0], 20)}, [ROWS])
    assert said.startswith("Confounded: press (mm) grows")


@pytest.mark.parametrize(
    ("columns", "heading", "commanded", "says"),
    [
        ({"tool": ["a"] * 36 + ["b"] * 4}, [], {}, "36 of 40 rows have tool a"),
        ({"session": ["a"] * 25 + ["b"] * 14 + ["c"]}, [], {}, "of session c there are few"),
        ({"tool": ["a"] * 40}, [0.1] * 30 + [2.0] * 10, {}, "75 % of the rows go one way"),
        ({"tool": ["a"] * 40}, [], {"press (mm)": np.full(40, 1.0)}, "press (mm) hardly varies"),
    ],
)
def test_warns_of_imbalanced_columns(
    columns: dict[str, Any], heading: list[float], commanded: dict[str, Any], says: str
) -> None:
    (said,) = imbalance(pa.table(columns), np.array(heading), commanded)
    assert says in said


def test_balanced_table_has_no_warnings() -> None:
    rng = np.random.default_rng(0)
    table = pa.table({"tool": ["a", "b"] * 40, "action_id": [*range(70), *range(5), *range(5)]})
    assert imbalance(table, rng.uniform(-3, 3, 80), {"press (mm)": rng.uniform(0, 1, 80)}) == []
    assert too_little(table) == []
    assert len(too_little(table.slice(0, 20))) == 2


def test_rank_correlation_handles_ties_and_constants() -> None:
    # In perfect order, eight ties of five take 8 (5³ - 5) of 40³ - 40 off the squared correlation.
    rho, _ = rank_correlation(ROWS.astype(float), np.repeat(np.arange(8.0), 5))
    assert rho == pytest.approx(np.sqrt(1 - 8 * (5**3 - 5) / (40**3 - 40)))
    assert rank_correlation(ROWS.astype(float), np.ones(40)) == (0.0, False)
