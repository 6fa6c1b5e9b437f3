"""The stage build_scenes: a table of scenes with a preview, from the generator or a local data set."""

import argparse
import io
import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image
from ruamel.yaml import YAML

from pentimento.contracts.images import read_image
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.tables import read_table
from pipelines.build_scenes import main

DRAWN = {"scenes": 40, "side_px": 32, "val_share": 0.1, "test_share": 0.2, "wordings": 4, "seed": 0}
SEGMENTATION = {"method": "classical", "sam_folder": None, "scale": 60.0, "min_share": 0.03, "points": 4}


def run(folder: Path, imported: dict | None) -> Path:
    section = {"named": None, "drawn": DRAWN, "imported": imported, "segmentation": SEGMENTATION}
    YAML(typ="safe").dump({"build_scenes": section}, folder / "params.yaml")
    main(argparse.Namespace(out=folder / "scenes"))
    return folder / "scenes"


def test_drawn_scenes_are_a_table_with_a_card_and_the_same_bytes_again(stage_folder: Path) -> None:
    out = run(stage_folder, None)
    assert read_table(out, CONTRACT).table.num_rows == 40
    assert "not seen in training" in (out / "README.md").read_text()
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["scenes"] == sum(metrics["split"].values()) == 40 and metrics["quarantined"] == {"all": 0}
    assert read_image(out / "preview.png").shape == (3 * 64, 12 * 32, 3)
    first = {file.name: file.read_bytes() for file in out.iterdir()}
    assert set(first) == {"README.md", "metrics.json", "part-00000.parquet", "preview.png"}
    run(stage_folder, None)
    assert {file.name: file.read_bytes() for file in out.iterdir()} == first


def test_a_local_data_set_is_taken_in_and_what_is_bad_is_counted(stage_folder: Path) -> None:
    stream = io.BytesIO()
    Image.new("RGB", (40, 40), (200, 30, 30)).save(stream, "PNG")
    images = [{"bytes": data, "path": None} for data in (stream.getvalue(), b"broken")]
    pq.write_table(pa.table({"image": images, "caption": ["a red square", "nothing"]}), stage_folder / "given.parquet")
    imported = {"path": str(stage_folder / "given.parquet"), "source": "given", "licence": "CC0-1.0", "side_px": 32}
    imported |= {"val_share": 0.0, "test_share": 0.0, "max_scenes": 10, "seed": 0}
    out = run(stage_folder, imported)
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["scenes"] == 1 and metrics["quarantined"] == {"all": 1, "not a readable picture": 1}
    assert "CC0-1.0" in (out / "README.md").read_text()


def test_the_reason_why_a_picture_is_left_out_may_have_any_letters(stage_folder: Path) -> None:
    images = []
    for picture in (Image.new("RGB", (40, 40), (200, 30, 30)), Image.new("I;16", (40, 40), 700)):
        stream = io.BytesIO()
        picture.save(stream, "PNG")
        images.append({"bytes": stream.getvalue(), "path": None})
    pq.write_table(pa.table({"image": images, "caption": ["a red square", "heights"]}), stage_folder / "given.parquet")
    imported = {"path": str(stage_folder / "given.parquet"), "source": "given", "licence": "CC0-1.0", "side_px": 32}
    imported |= {"val_share": 0.0, "test_share": 0.0, "max_scenes": 10, "seed": 0}
    metrics = json.loads((run(stage_folder, imported) / "metrics.json").read_text())
    assert metrics["quarantined"] == {"all": 1, "colour mode I;16": 1}


def test_named_things_are_painted_and_drawn_with_a_pen(stage_folder: Path) -> None:
    named = {
        "scenes": 12, "side_px": 32, "val_share": 0.2, "test_share": 0.3, "pen_share": 0.0, "wordings": 2,
        "alone_share": 0.5, "mirrored_share": 0.0, "places": "usual", "tinted_share": 0.0,
        "sources": ["openmoji"], "seed": 0,
    }  # fmt: skip
    section = {"named": named, "drawn": DRAWN, "imported": None, "segmentation": SEGMENTATION}
    YAML(typ="safe").dump({"build_scenes": section}, Path("params.yaml"))
    main(argparse.Namespace(out=Path("scenes")))
    table = read_table(Path("scenes"), CONTRACT).table
    assert table.num_rows == 12 and table["pen"].null_count == 0
    assert "CC-BY-SA-4.0" in (Path("scenes") / "README.md").read_text()
