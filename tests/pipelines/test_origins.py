"""Whose data a run read and under which licence: said by rows, by cards that the stages write, or not at all."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.contracts import scenes
from pentimento.contracts.tables import write_table
from pentimento.copainting.synthesis.dataset import Threshold, dataset_card
from pipelines._tracking.origins import described_origin, origin_tags
from tests.copainting.painters import MARKER


def rows(*origins: tuple[str | None, str | None]) -> pa.Table:
    return pa.table({"source": [source for source, _ in origins], "licence": [licence for _, licence in origins]})


def test_scenes_say_it_row_by_row(tmp_path: Path) -> None:
    write_table(tmp_path / "scenes", scenes.example_table(6), scenes.CONTRACT, "# Scenes\n\nFor a test.\n")
    tags = origin_tags({"scenes": tmp_path / "scenes"})
    assert tags == {"source:scenes": "example (6 rows)", "licence:scenes": "CC0-1.0"}
    assert described_origin(tags, "scenes") == "example (6 rows); licence CC0-1.0"


def test_rows_of_several_origins_are_counted_over_all_shards(tmp_path: Path) -> None:
    drawn, taken = ("drawn", "CC0-1.0"), ("a collection", "CC-BY-4.0")
    pq.write_table(rows(drawn, taken, taken), tmp_path / "part-00000.parquet")
    pq.write_table(rows(drawn, (None, None)), tmp_path / "part-00001.parquet")
    tags = origin_tags({"scenes": tmp_path})
    assert tags["source:scenes"] == "a collection (2 rows); drawn (2 rows)"
    assert tags["licence:scenes"] == "CC-BY-4.0 (a collection); CC0-1.0 (drawn)"


def test_the_card_of_co_paintings_says_it_of_their_scenes(tmp_path: Path) -> None:
    metrics = {
        "pairs": 2, "paintings": 1, "strategies": {}, "split": dict.fromkeys(scenes.SPLITS, 0), "threshold": 0.3,
        "kept_share": {"pairs": 1.0, "paintings": 1.0},
    }  # fmt: skip
    card = dataset_card(
        "marker",
        MARKER,
        Threshold(0.5, None, 0),
        metrics=metrics,
        scenes=rows(("drawn, by hand", "CC0-1.0")),
        scorer="cafe",
    )
    (tmp_path / "README.md").write_text(card)
    pq.write_table(pa.table({"scene_id": ["a"]}), tmp_path / "part-00000.parquet")
    tags = origin_tags({"copaintings": tmp_path})
    assert tags == {"source:copaintings": "drawn, by hand (1 scenes)", "licence:copaintings": "CC0-1.0"}


@pytest.mark.parametrize(
    ("card", "source", "licence"),
    [
        (
            "# Strokes\n\nMade by the robot\nin the studio. 9 rows.\n\nMore.",
            "Made by the robot in the studio. 9 rows.",
            None,
        ),
        ("---\ntask: paint\nlicense: cc-by-4.0\n---\n\n# Atelier\n\nBy a person.", "By a person.", "cc-by-4.0"),
        ("# Strokes\n\n| column |\n| --- |\n", None, None),
        ("", None, None),
    ],
)
def test_another_card_says_it_in_its_first_paragraph(
    card: str, source: str | None, licence: str | None, tmp_path: Path
) -> None:
    (tmp_path / "README.md").write_text(card)
    tags = origin_tags({"strokes": tmp_path})
    assert (tags.get("source:strokes"), tags.get("licence:strokes")) == (source, licence)
    assert described_origin(tags, "strokes") == (
        f"{source.rstrip('.')}; licence {licence or 'not recorded'}" if source else ""
    )


def test_what_cannot_be_read_is_not_known(tmp_path: Path) -> None:
    """The stage that reads it says what is wrong, not the tracking."""
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn/part-00000.parquet").write_bytes(b"PAR1 torn")
    (tmp_path / "card").mkdir()
    (tmp_path / "card/README.md").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "model.json").write_text("{}")
    assert origin_tags({name: tmp_path / name for name in ("torn", "card", "model.json", "absent")}) == {}
