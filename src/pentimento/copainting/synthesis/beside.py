"""Pairs that ask for one thing beside another: two paintings, each in its half, laid on one sheet (thesis 6.6.1).

A person who draws together with somebody leaves room, and asks for what is missing, not for the whole. Strokes in one
half do not touch those in the other, so the two paintings on one sheet are what the robot's own model foretells of both
plans, one after the other; thousands of such pairs come of a few hundred plans.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from pentimento.contracts.images import decode_png, encode_png
from pentimento.copainting.scenes.halves import opposite
from pentimento.copainting.scenes.phrases import phrase
from pentimento.copainting.synthesis.pairs import Image, Row

_NAMED_SHARE = 0.3
"""Of the requests: the thing's name alone, not one of its scene's wordings."""


def beside_pairs(
    paintings: Sequence[Row],
    scenes: Mapping[str, Mapping[str, Any]],
    wordings: Callable[[Mapping[str, Any]], list[str]],
    together: Collection[frozenset[str]],
    number: int,
    seed: int,
) -> list[Row]:
    """Rows of the `copaintings` contract: each painting asked for beside `number` others at most, of its own split.

    Args:
        paintings: rows of that contract, one for each half scene, from the blank sheet (strategy `all`).
        scenes: the half scenes by `scene_id` (`scenes.halves`).
        wordings: what may be said of a half scene.
        together: kinds that may stand on one sheet; what is held out is not put together. Scenes that name no kinds
            stand beside any.

    Each row has the id, the score and the split of the scene that is asked for. A painting's pairs depend on the
    paintings and (seed, its place) only.
    """
    places: dict[tuple[str, str], list[int]] = {}
    for place, row in enumerate(paintings):
        places.setdefault((row["split"], scenes[row["scene_id"]]["arrangement"]), []).append(place)
    pictures = [decode_png(row["full"]["bytes"]) for row in paintings]
    made = []
    for place, row in enumerate(paintings):
        generator = np.random.default_rng([seed, place])
        scene = scenes[row["scene_id"]]
        free = places.get((row["split"], opposite(scene["arrangement"])), [])
        fitting = [other for other in free if _may_meet(scene, scenes[paintings[other]["scene_id"]], together)]
        paper = decode_png(row["partial"]["bytes"])
        for other in generator.permutation(fitting)[:number]:
            made.append(
                _pair(row, scene, paintings[other], pictures[place], pictures[other], paper, wordings, generator)
            )
    return made


def laid_over(one: Image, other: Image, paper: Image) -> Image:
    """Both paintings on one sheet, sRGB [H, W, 3]: each pixel is of that which differs from the paper the more."""
    marked, marked_too = (np.abs(picture.astype(np.int16) - paper).sum(-1) for picture in (one, other))
    return np.where((marked_too > marked)[..., None], other, one)


def _pair(
    row: Row, scene: Mapping[str, Any], there: Row, asked: Image, before: Image, paper: Image,
    wordings: Callable[[Mapping[str, Any]], list[str]], generator: np.random.Generator,
) -> Row:  # fmt: skip
    said = wordings(scene)
    named = len(scene.get("objects") or ()) == 1 and generator.random() < _NAMED_SHARE
    return row | {
        "strategy": "beside",
        "caption": phrase(scene["objects"][0]) if named else said[int(generator.integers(len(said)))],
        "partial": {"bytes": encode_png(before), "path": None},
        "full": {"bytes": encode_png(laid_over(before, asked, paper)), "path": None},
        "plan_id": f"{there['plan_id']} + {row['plan_id']}",
        "kept": [True] * len(there["kept"]) + [False] * len(row["kept"]),
    }


def _may_meet(one: Mapping[str, Any], other: Mapping[str, Any], together: Collection[frozenset[str]]) -> bool:
    kinds, others = one.get("objects") or (), other.get("objects") or ()
    return all(frozenset((a, b)) in together for a in kinds for b in others)
