"""Imported scenes in three layouts, and the count of unusable items."""

import io
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from pentimento.contracts import picture_files
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.schema import row_faults
from pentimento.copainting.scenes.imported_scenes import ImportedConfig, import_scenes


def config(path: Path, **changes: object) -> ImportedConfig:
    values = {"path": str(path), "source": "a test", "licence": "CC0-1.0", "side_px": 32, "val_share": 0.1}
    values |= {"test_share": 0.2, "max_scenes": 1000, "seed": 0}
    return ImportedConfig(**(values | changes))


def blank(image: np.ndarray) -> np.ndarray:
    return np.zeros(image.shape[:2], np.uint8)


def picture(mode: str = "RGB", kind: str = "PNG", size: tuple[int, int] = (48, 40), color: object = None) -> bytes:
    stream = io.BytesIO()
    Image.new(mode, size, color if color is not None else 128 if mode in "L1" else (200, 10, 30)).save(stream, kind)
    return stream.getvalue()


def parquet(path: Path, rows: list[tuple[bytes | None, object]], text: str = "caption") -> Path:
    table = pa.table({"image": [{"bytes": data, "path": None} for data, _ in rows], text: [words for _, words in rows]})
    pq.write_table(table, path)
    return path


def test_import_counts_unusable_items_by_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture_files, "MAX_PIXELS", 10_000)
    half_clear = picture("RGBA", color=(10, 20, 30, 90))
    rows = [
        (picture(), "a red square"),
        (picture("L"), "grey"),
        (picture("RGBA", color=(1, 2, 3, 255)), "opaque"),
        (picture()[:60], "cut off"),
        (b"not an image", "text"),
        (picture(size=(200, 200)), "too large"),
        (picture("CMYK", "JPEG", color=(1, 2, 3, 4)), "four inks"),
        (half_clear, "half clear"),
        (picture(), "  \n "),
        (picture(), None),
        (None, "nothing"),
        (picture(), "猫が月の下にいる"),
        (picture(), "very long " * 1000),
    ]
    found = import_scenes(config(parquet(tmp_path / "a.parquet", rows)), blank)
    assert found.quarantined == {
        "not a readable picture": 2,
        "more than 10000 pixels": 1,
        "colour mode CMYK": 1,
        "transparent": 1,
        "empty caption": 2,
        "missing picture": 1,
    }
    assert row_faults(found.table, CONTRACT) == [None] * 5
    captions = found.table.column("caption").to_pylist()
    assert captions[3] == "猫が月の下にいる" and len(captions[4]) <= 2000
    image = decode_png(found.table.column("image")[0].as_py()["bytes"])
    assert image.shape == (32, 32, 3) and (image == [200, 10, 30]).all()
    assert found.table.column("licence").to_pylist() == ["CC0-1.0"] * 5


def test_imports_coco_and_image_folder_layouts(tmp_path: Path) -> None:
    coco = tmp_path / "coco"
    (coco / "annotations").mkdir(parents=True)
    (coco / "val2017").mkdir()
    (coco / "val2017/1.jpg").write_bytes(picture(kind="JPEG"))
    gone = {"image_id": 2, "caption": "gone"}
    content = {
        "images": [{"id": 1, "file_name": "1.jpg"}, {"id": 2, "file_name": "2.jpg"}],
        "annotations": [{"image_id": 1, "caption": "one"}, {"image_id": 1, "caption": "two"}, gone],
    }
    (coco / "annotations/captions_val2017.json").write_text(json.dumps(content))
    found = import_scenes(config(coco), blank)
    assert found.table.column("captions").to_pylist() == [["one", "two"]]
    assert found.table.column("source").to_pylist() == ["a test: 1.jpg"]
    assert found.quarantined == {"missing picture": 1}

    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "a.png").write_bytes(picture())
    (folder / "metadata.jsonl").write_text(json.dumps({"file_name": "a.png", "text": "a red one"}) + "\n")
    found = import_scenes(config(folder), blank)
    assert found.table.column("caption").to_pylist() == ["a red one"]


@pytest.mark.parametrize(
    "names",
    [
        ["a.png", "b_train.png", "train c.png", "d.png", "e.png"],
        ["train/a.png", "test/b.png", "validation/c.png", "eval/d.JPG", "e.png"],
        ["test/a.png", "test/b.png"],
    ],
)
@pytest.mark.parametrize("kind", ["csv", "jsonl", "parquet"])
def test_every_picture_of_a_folder_is_used_whatever_it_is_called(tmp_path: Path, names: list[str], kind: str) -> None:
    for name in [*names, "left over.png", "deep/er.png", "._hidden.png"]:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(picture())
    (tmp_path / f"._metadata.{kind}").write_bytes(b"\0\5\x16\7")  # as macOS writes
    rows = [{"file_name": name, "text": f"picture {number}"} for number, name in enumerate([*names, "gone.png"])]
    metadata = tmp_path / f"metadata.{kind}"
    if kind == "csv":
        lines = [f"{row['file_name']},{row['text']}" for row in rows]
        metadata.write_text("\n".join(["file_name,text", *lines]), encoding="utf-8-sig")
    elif kind == "jsonl":
        metadata.write_text("\n".join(json.dumps(row) for row in rows))
    else:
        pq.write_table(pa.Table.from_pylist(rows), metadata)
    found = import_scenes(config(tmp_path), blank)
    captions = [f"picture {number}" for number in range(len(names))]
    assert found.table.column("caption").to_pylist() == captions
    assert found.quarantined == {"missing picture": 1, "empty caption": 2}


def test_metadata_in_each_folder_and_parquet_beside_hidden_files(tmp_path: Path) -> None:
    for split in ("train", "test"):
        (tmp_path / "pictures" / split).mkdir(parents=True)
        (tmp_path / "pictures" / split / "p.png").write_bytes(picture())
        metadata = json.dumps({"file_name": "p.png", "captions": [split, "both"]})
        (tmp_path / "pictures" / split / "metadata.jsonl").write_text(metadata)
    found = import_scenes(config(tmp_path / "pictures"), blank)
    assert found.table.column("captions").to_pylist() == [["test", "both"], ["train", "both"]]
    (tmp_path / "hub/data").mkdir(parents=True)
    for split in ("train", "test"):
        parquet(tmp_path / f"hub/data/{split}-00000-of-00001.parquet", [(picture(), split)])
    (tmp_path / "hub/data/._train-00000-of-00001.parquet").write_bytes(b"of macOS")
    found = import_scenes(config(tmp_path / "hub"), blank)
    assert found.table.column("caption").to_pylist() == ["test", "train"]


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ('{"file_name": "../a.png", "text": "x"}', "which is not in"),
        ('{"file_name": null, "text": "x"}', "names the picture ''"),
        ('{"text": "x"}', "lacks file_name"),
        ('{"file_name": "a.png"}', "lacks file_name or one of captions, caption, text"),
        ("[1]", "lacks file_name"),
        ("{", "cannot be read"),
    ],
)
def test_metadata_that_name_no_picture_are_refused(tmp_path: Path, line: str, sentence: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder/metadata.jsonl").write_text(line)
    with pytest.raises(ContractError, match=sentence):
        import_scenes(config(tmp_path / "folder"), blank)


def test_rejects_unsupported_import_layouts(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no captioned pictures"):
        import_scenes(config(tmp_path), blank)
    with pytest.raises(ContractError, match="needed are image and one of"):
        import_scenes(config(parquet(tmp_path / "b.parquet", [(picture(), "x")], "title")), blank)
    with pytest.raises(ContractError, match=r"No scene of .* can be used: 1 x not a readable picture"):
        import_scenes(config(parquet(tmp_path / "c.parquet", [(b"x", "x")])), blank)
    with pytest.raises(ValueError, match="source and licence"):
        config(tmp_path, licence=" ")


def test_split_of_an_imported_item_does_not_depend_on_others(tmp_path: Path) -> None:
    rows = [(picture(), f"number {n}") for n in range(12)]
    whole = import_scenes(config(parquet(tmp_path / "d.parquet", rows)), blank).table.column("split").to_pylist()
    some = import_scenes(config(parquet(tmp_path / "e.parquet", rows[:6])), blank).table.column("split").to_pylist()
    assert whole[:6] == some and len(set(whole)) > 1
