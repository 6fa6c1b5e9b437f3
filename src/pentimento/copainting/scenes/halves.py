"""Scenes that leave room: one thing in one half of the sheet, as a person draws who goes on together with somebody."""

from __future__ import annotations

from itertools import islice
from typing import Any, Final

import numpy as np
import pyarrow as pa

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png, encode_png
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.scenes.collage import HALVES, Half, put
from pentimento.copainting.scenes.edits import without

_PLACES: Final = [half for pair in HALVES for half in pair]
_NAMES: Final = ("left", "right", "upper", "lower")


def half_scenes(scenes: pa.Table, count: int, seed: int) -> pa.Table:
    """`count` rows of the `scenes` contract: scenes with one thing, which lies in one half of the sheet, on its ground.

    They are the first scenes with one thing of a checked table that has `scene_id` and `split`; where there are fewer
    than `count`, they come again in another half. `arrangement` says which half: left, right, upper or lower, in turn.
    Row i depends on the table and (seed, i) only.

    Raises:
        ContractError: no scene has one thing.
    """
    alone = list(islice((row for row in scenes.to_pylist() if _things(row) == 1), count))
    if count and not alone:
        raise ContractError("No scene shows one thing alone, to be put in one half of a sheet: ask for no half scenes.")
    rows = [_half(alone[i % len(alone)], (i + i // len(alone)) % len(_NAMES), [seed, i]) for i in range(count)]
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def opposite(name: str) -> str:
    """The half that another half leaves free."""
    place = _NAMES.index(name)
    return _NAMES[place + 1 if place % 2 == 0 else place - 1]


def _half(row: dict[str, Any], place: int, seed: list[int]) -> dict[str, Any]:
    generator = np.random.default_rng(seed)
    image, regions = decode_png(row["image"]["bytes"]), decode_png(row["regions"]["bytes"])
    half: Half = _PLACES[place]
    ground = without(image, regions, np.unique(regions[regions > 0]))
    moved, there = put(ground, image, regions, half, generator)
    return row | {
        "image": {"bytes": encode_png(moved), "path": None},
        "regions": {"bytes": encode_png(there.astype(np.uint8)), "path": None},
        "scene_id": f"{row['scene_id']}/{_NAMES[place]}",
        "arrangement": _NAMES[place],
    }


def _things(row: dict[str, Any]) -> int:
    regions = decode_png(row["regions"]["bytes"])
    return len(np.unique(regions[regions > 0]))
