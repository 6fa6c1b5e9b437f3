"""What the painting and the clay studio share: random streams, the state of an arm's gears, reading world files."""

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pentimento.contracts.codec import find_toml, from_plain, read_toml
from pentimento.contracts.errors import ConfigError

World = TypeVar("World")


class Item(IntEnum):
    """Kind of an item that draws random numbers."""

    SHEET = 1
    TOOL = 2
    DIP = 3
    STROKE = 4
    PHOTO = 5
    TABLE = 6
    SLAB = 7
    PUSH = 8
    SCAN = 9
    ROOM = 10
    PLACE = 11


def item_rng(seed: int, kind: Item, index: int) -> np.random.Generator:
    """Generator of item `index` of its `kind` under the world's `seed`: an item depends on nothing but its id."""
    return np.random.default_rng([seed, int(kind), index])


@dataclass(frozen=True)
class Gears:
    """Where the motors rest (x_m, y_m), and the position of the driven side within its play, per axis."""

    rest_m: tuple[float, float] = (0.0, 0.0)
    play_m: tuple[float, float] = (0.0, 0.0)


def read_world(kind: type[World], name_or_path: str | Path, folder: Path) -> World:
    """The world in a world file: the name of one in the folder of shipped worlds, or the path of a `.toml` file.

    A world file has one table for each section of the dataclass `kind`. `base = "other.toml"` before the tables takes
    every key that the file does not set from another world file of the same folder.

    Raises:
        ConfigError: a file is missing, is not valid TOML or is its own base; or a key is missing, unknown or of the
            wrong type.
    """
    path = find_toml(name_or_path, folder, "world")
    return from_plain(kind, _sections(path, folder, ()), f"World file {path}", ConfigError)


def _sections(path: Path, folder: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    """The sections of a world file over those of its base."""
    if path in seen:
        raise ConfigError(f"World file {path} is its own base; remove one `base` line from the circle.")
    document = read_toml(path, "world")
    base = document.pop("base", None)
    if base is None:
        return document
    if not isinstance(base, str):
        raise ConfigError(f"World file {path} has the base {base!r}; write the name of a world file.")
    merged = _sections(find_toml(path.parent / base, folder, "world"), folder, (*seen, path))
    for key, section in document.items():
        if not isinstance(section, dict):
            raise ConfigError(f"World file {path} has a key '{key}' outside a section; move it into a [section].")
        merged[key] = {**merged.get(key, {}), **section}
    return merged
