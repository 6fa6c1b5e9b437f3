"""Pictures of a study from folders: one for each condition, files of one name show one item."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import read_image
from pentimento.rating.page import Picture
from pentimento.rating.study import Study

PICTURES: Final = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
"""Endings of picture files; other files in a folder of pictures are left alone."""
_TEXT: Final = ".txt"
_SHAPES_DIFFER: Final = 0.02
"""Relative difference of two aspect ratios that a rater could see."""


def read_items(conditions: Mapping[str, Path]) -> dict[str, dict[str, Picture]]:
    """Pictures uint8 sRGB [H, W, 3] by item and condition, from the folder of each condition.

    Raises:
        ConfigError: a folder has no picture, or not those of the first one.
        ImageError: a file is no picture.
    """
    files = {name: _by_stem(folder, PICTURES) for name, folder in conditions.items()}
    (first, items), *others = files.items()
    for name, found in others:
        if differing := sorted(items.keys() ^ found.keys()):
            raise ConfigError(
                f"{conditions[first]} and {conditions[name]} do not show the same items: only one has {differing[0]}. "
                "Give the pictures of one item the same name in every folder."
            )
    return {item: {name: read_image(files[name][item]) for name in files} for item in items}


def read_references(study: Study, folder: Path | None, names: Iterable[str]) -> dict[str, Picture | str]:
    """The picture or text of each name (an item, or a condition where the form is match); empty where none is shown.

    Raises:
        ConfigError: the study needs a folder and there is none, or the other way round, or a name has no file.
        ImageError: a file is no picture.
    """
    if study.reference == "none":
        if folder is not None:
            raise ConfigError("This study shows no reference; leave --references out.")
        return {}
    endings = (_TEXT,) if study.reference == "text" else PICTURES
    if folder is None:
        raise ConfigError(f"This study shows a {study.reference} beside the pictures; give --references FOLDER.")
    files = _by_stem(folder, endings)
    if missing := [name for name in names if name not in files]:
        raise ConfigError(f"{folder} has no {study.reference} of {missing[0]}: write it into {missing[0]}{endings[0]}.")
    if study.reference == "text":
        return {name: " ".join(files[name].read_text(encoding="utf-8").split()) for name in names}
    return {name: read_image(files[name]) for name in names}


def telling_shapes(items: Mapping[str, Mapping[str, Picture]]) -> list[str]:
    """Items whose pictures differ in shape, by which a rater could tell the conditions."""
    ratios = {item: [p.shape[1] / p.shape[0] for p in shown.values()] for item, shown in items.items()}
    return [item for item, of_item in ratios.items() if max(of_item) > (1 + _SHAPES_DIFFER) * min(of_item)]


def _by_stem(folder: Path, endings: tuple[str, ...]) -> dict[str, Path]:
    if not folder.is_dir():
        raise ConfigError(f"{folder} is no folder; give one with files that end in {', '.join(endings)}.")
    found: dict[str, Path] = {}
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in endings:
            continue
        if file.stem in found:
            raise ConfigError(f"{folder} has {found[file.stem].name} and {file.name}; keep one file of each name.")
        found[file.stem] = file
    if not found:
        raise ConfigError(f"{folder} has no file that ends in {', '.join(endings)}.")
    return found
