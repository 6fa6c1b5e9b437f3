"""Captioned pictures from a local folder or Parquet file, converted to the `scenes` contract.

Three layouts are supported: a folder in COCO's layout (`annotations/captions_*.json` beside folders of pictures), an
image folder as for `datasets` (pictures beside or below `metadata.csv`, `.jsonl` or `.parquet` with `file_name` and
`caption`, `captions` or `text`), and Parquet with an image column and one of these. Nothing is downloaded. Every
picture is used, or left out and counted by reason; names such as `train` and `test` mean nothing, because the seed
draws the split.
"""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from unicodedata import normalize

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import image_cell
from pentimento.contracts.picture_files import PictureError, decode_picture
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.contracts.scenes import CONTRACT, split_of
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.tables import parquet_files, visible

MAX_CHARACTERS: Final = 2_000
"""Of a caption. The rest is cut off, because text encoders read the first few dozen tokens only."""


@dataclass(frozen=True)
class ImportedConfig:
    """A local data set of captioned pictures that replaces the drawn scenes."""

    path: str
    """A folder or a Parquet file."""
    source: str
    """Its name in each row, e.g. "COCO 2017"."""
    licence: str
    """The licence of the pictures."""
    side_px: int
    val_share: float
    test_share: float
    max_scenes: int
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 16, "side_px")
        at_least(self, 0, "val_share", "test_share", "seed")
        above_zero(self, "max_scenes")
        if not (self.source.strip() and self.licence.strip()):
            raise ValueError("source and licence must be given: each scene records them.")


@dataclass(frozen=True, eq=False)
class Imported:
    """The usable scenes, and the number of unusable ones by reason."""

    table: pa.Table
    quarantined: dict[str, int]


@dataclass(frozen=True)
class _Item:
    name: str
    data: bytes | None
    captions: list[str]


class _Unusable(Exception):
    """A picture or caption is left out; the message is the reason that is counted."""


def import_scenes(config: ImportedConfig, regions: Callable[[NDArray[np.uint8]], NDArray[np.uint8]]) -> Imported:
    """Read a data set; the split of each item is drawn by (seed, number).

    Args:
        regions: maps a picture [H, W, 3] to its label mask [H, W], see `semantics.segmentation`.

    Raises:
        ConfigError: there is nothing at the path, or its layout is not supported.
        ContractError: a column is missing, or no scene is usable.
    """
    rows: list[dict[str, Any]] = []
    bad: Counter[str] = Counter()
    for number, item in enumerate(_items(Path(config.path))):
        if len(rows) == config.max_scenes:
            break
        try:
            rows.append(_row(number, item, config, regions))
        except _Unusable as reason:
            bad[str(reason)] += 1
    if not rows:
        found = "; ".join(f"{count} x {reason}" for reason, count in bad.items()) or "it is empty"
        raise ContractError(f"No scene of {config.path} can be used: {found}.")
    return Imported(pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT)), dict(sorted(bad.items())))


def load_picture(data: bytes) -> NDArray[np.uint8]:
    """The sRGB pixels [H, W, 3] of an opaque image file, see `decode_picture`.

    Raises:
        _Unusable: it is corrupt, too large, transparent, or in colours without a unique conversion to sRGB.
    """
    try:
        return decode_picture(data, "The picture", plain=True)
    except PictureError as error:
        raise _Unusable(error.reason) from error


def _row(
    number: int, item: _Item, config: ImportedConfig, regions: Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
) -> dict[str, Any]:
    captions = [" ".join(text.split())[:MAX_CHARACTERS] for text in item.captions]
    captions = list(dict.fromkeys(text for text in captions if text))
    if not captions:
        raise _Unusable("empty caption")
    if item.data is None:
        raise _Unusable("missing picture")
    image = _square(load_picture(item.data), config.side_px)
    chance = np.random.default_rng([config.seed, 1, number]).random()
    return {
        "image": image_cell(image),
        "caption": captions[0],
        "regions": image_cell(regions(image)),
        "source": f"{config.source}: {item.name}",
        "licence": config.licence,
        "scene_id": f"scene_{number:06d}",
        "split": split_of(chance, config.val_share, config.test_share),
        "captions": captions,
    }


def _square(image: NDArray[np.uint8], side_px: int) -> NDArray[np.uint8]:
    """The largest centred square, resized to a side."""
    side = min(image.shape[:2])
    top, left = (image.shape[0] - side) // 2, (image.shape[1] - side) // 2
    part = np.ascontiguousarray(image[top : top + side, left : left + side])
    how = cv2.INTER_AREA if side >= side_px else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(part, (side_px, side_px), interpolation=how), dtype=np.uint8)


def _items(path: Path) -> Iterator[_Item]:
    if path.is_dir():
        annotations = sorted(path.glob("annotations/captions_*.json")) or sorted(path.glob("captions_*.json"))
        if annotations:
            for file in annotations:
                yield from _coco(path, file)
            return
        listed = sorted(file for name in _METADATA for file in path.rglob(name))
        if listed:
            yield from _image_folder(path, listed)
            return
        for folder in (path, path / "data"):  # as on the Hugging Face Hub
            if folder.is_dir() and (files := parquet_files(folder)):
                yield from _parquet(files)
                return
    elif path.suffix == ".parquet" and path.is_file():
        yield from _parquet([path])
        return
    raise ConfigError(
        f"{path} holds no captioned pictures: give a Parquet file, a folder of them, a folder with metadata.csv or "
        "metadata.jsonl beside its pictures, or one in COCO's layout (annotations/captions_*.json)."
    )


def _coco(root: Path, file: Path) -> Iterator[_Item]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        names = {entry["id"]: entry["file_name"] for entry in content["images"]}
        captions: dict[Any, list[str]] = {}
        for entry in content["annotations"]:
            captions.setdefault(entry["image_id"], []).append(str(entry["caption"]))
    except (ValueError, KeyError, TypeError) as error:
        raise ContractError(f"{file} is no file of COCO captions ({type(error).__name__}: {error}).") from error
    split = file.stem.removeprefix("captions_")
    for number, name in names.items():
        places = [root / split / name, root / "images" / split / name, root / "images" / name, root / name]
        found = next((place for place in places if place.is_file()), None)
        yield _Item(name, found.read_bytes() if found else None, captions.get(number, []))


_METADATA: Final = ("metadata.csv", "metadata.jsonl", "metadata.parquet")
_PICTURES: Final = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".gif")
_CAPTIONS: Final = ("captions", "caption", "text")


def _image_folder(root: Path, listed: list[Path]) -> Iterator[_Item]:
    """Every picture of the folder, whatever its subfolders are called: those that metadata name, then all others."""
    named: set[Path] = set()
    for file in listed:
        for row in _metadata_rows(file):
            name = str(row.get("file_name") or "")
            text = next((row[column] for column in _CAPTIONS if column in row), None)
            place = (file.parent / name).resolve()
            if not name or not place.is_relative_to(root.resolve()):
                raise ContractError(f"{file} names the picture {name[:80]!r}, which is not in {root}; correct it.")
            place = next((p for form in ("NFC", "NFD") if (p := Path(normalize(form, str(place)))).is_file()), place)
            named.add(place)
            captions = text if isinstance(text, list) else [text]
            data = place.read_bytes() if place.is_file() else None
            yield _Item(place.name, data, [str(caption) for caption in captions if caption is not None])
    for file in sorted(visible(root.rglob("*"))):
        if file.suffix.lower() in _PICTURES and file.is_file() and file.resolve() not in named:
            yield _Item(file.name, file.read_bytes(), [])


def _metadata_rows(file: Path) -> list[dict[str, Any]]:
    try:
        if file.suffix == ".parquet":
            rows = pq.read_table(file).to_pylist()
        elif file.suffix == ".csv":
            with file.open(encoding="utf-8-sig", newline="") as opened:
                rows = list(csv.DictReader(opened))
        else:
            rows = [json.loads(line) for line in file.read_text(encoding="utf-8-sig").split("\n") if line.strip()]
    except (OSError, ValueError, csv.Error, pa.ArrowException) as error:
        raise ContractError(f"{file} cannot be read ({' '.join(str(error).split())}); save it again.") from error
    if not all(isinstance(row, dict) and "file_name" in row and any(name in row for name in _CAPTIONS) for row in rows):
        raise ContractError(f"{file} lacks file_name or one of {', '.join(_CAPTIONS)}.")
    return rows


def _parquet(files: list[Path]) -> Iterator[_Item]:
    import datasets

    yield from _rows(datasets.Dataset.from_parquet([str(file) for file in files]), str(files[0].parent))


def _rows(found: Any, where: str) -> Iterator[_Item]:
    import datasets

    names = found.column_names
    text = next((name for name in _CAPTIONS if name in names), None)
    if text is None or "image" not in names:
        raise ContractError(
            f"{where} has the columns {', '.join(names)}; needed are image and one of captions, caption, text."
        )
    found = found.cast_column("image", datasets.Image(decode=False))
    for number, row in enumerate(found):
        captions = row[text] if isinstance(row[text], list) else [row[text]]
        image = row["image"] or {"bytes": None, "path": None}
        data, path = image["bytes"], image["path"]
        if data is None and path and Path(path).is_file():
            data = Path(path).read_bytes()
        yield _Item(
            Path(path).name if path else str(number), data, [str(text) for text in captions if text is not None]
        )
