"""Ordinary edits of scenes: pairs of a picture that lacks something and the picture that has it.

They teach a goal planner's base what pictures show and that a request adds to what is there, before it meets anything
that a robot made. The thesis starts from Instruct-Pix2Pix, which was trained on a million such edits (6.4.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png

_BLANK_SHARE: Final = 0.25  # of the edits: all things are missing
_PAPER_SHARE: Final = 0.5  # of those: the ground, too; a sheet of white paper
_PAPER_SRGB: Final = 250
_MARGIN_PX: Final = 2  # around a region, for the soft edge of what stood there
_HOLD_OUT_EVERY: Final = 10


@dataclass(frozen=True, eq=False)
class Pair:
    """What a goal planner is given, and what it should make of it."""

    input: NDArray[np.uint8]
    """sRGB [H, W, 3]."""
    target: NDArray[np.uint8]
    """sRGB [H, W, 3]."""
    caption: str


def scene_edits(scenes: pa.Table, variants: int, seed: int) -> list[Pair]:
    """`variants` edits of each scene in a checked `scenes` table; row i's depend on (seed, i) only.

    The target is the scene; the input lacks one or more of its things, which its ground replaces, or is blank.

    Raises:
        ContractError: the pictures differ in size, or a mask's size is not its picture's.
    """
    rows = scenes.to_pylist()
    pairs = [
        _edit(row, np.random.default_rng([seed, index, variant]), index)
        for index, row in enumerate(rows)
        for variant in range(variants)
    ]
    sizes = {pair.target.shape for pair in pairs}
    if len(sizes) > 1:
        raise ContractError(f"The scenes are of {len(sizes)} sizes, e.g. {sorted(sizes)[:2]}; make them one size.")
    return pairs


def pairs_of(copaintings: pa.Table, split: str) -> list[Pair]:
    """The co-paintings of one split as pairs: from the partial painting to the full one (thesis 6.4.1)."""
    chosen = copaintings.filter(pa.array([name == split for name in copaintings["split"].to_pylist()], pa.bool_()))
    return [
        Pair(decode_png(row["partial"]["bytes"]), decode_png(row["full"]["bytes"]), row["caption"])
        for row in chosen.select(["partial", "full", "caption"]).to_pylist()
    ]


def scenes_of(scenes: pa.Table, split: str) -> pa.Table:
    """The scenes of one split; where the table has none, every tenth scene is `val` and the others are `train`."""
    if "split" in scenes.column_names and None not in (names := scenes["split"].to_pylist()):
        return scenes.filter(pa.array([name == split for name in names], pa.bool_()))
    held_out = [index % _HOLD_OUT_EVERY == 0 for index in range(scenes.num_rows)]
    return scenes.filter(pa.array([apart == (split == "val") for apart in held_out], pa.bool_()))


def without(image: NDArray[np.uint8], regions: NDArray[np.uint8], labels: NDArray[np.integer]) -> NDArray[np.uint8]:
    """The picture with the ground painted over the regions of these labels.

    Each row gets the median of what ground that row shows, for a ground changes from top to bottom more than across,
    and a smear would tell where something stood; a row without ground gets the median of all ground.
    """
    margin = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)
    things = cv2.dilate((regions > 0).astype(np.uint8), margin) > 0
    gone = (cv2.dilate(np.isin(regions, labels).astype(np.uint8), margin) > 0) & ~(
        (regions > 0) & ~np.isin(regions, labels)  # what stays is not touched, also where it touches what goes
    )
    blank = np.full((1, 3), _PAPER_SRGB)
    anywhere = np.median(image[~things] if not things.all() else blank, axis=0)
    fill = np.stack(
        [
            np.median(row[~covered], axis=0) if not covered.all() else anywhere
            for row, covered in zip(image, things, strict=True)
        ]
    ).astype(np.uint8)
    return np.where(gone[..., None], fill[:, None], image)


def _edit(row: dict[str, Any], generator: np.random.Generator, index: int) -> Pair:
    image, regions = decode_png(row["image"]["bytes"]), decode_png(row["regions"]["bytes"])
    if regions.shape != image.shape[:2]:
        raise ContractError(f"Scene {index}'s regions are {regions.shape}, its image {image.shape[:2]}; match them.")
    captions = row.get("captions") or [row["caption"]]
    caption = str(captions[int(generator.integers(len(captions)))])
    labels = np.unique(regions[regions > 0])
    if generator.random() < _BLANK_SHARE or not labels.size:
        if generator.random() < _PAPER_SHARE or not labels.size:
            return Pair(np.full_like(image, _PAPER_SRGB), image, caption)
        return Pair(without(image, regions, labels), image, caption)
    missing = generator.permutation(labels)[: int(generator.integers(1, labels.size + 1))]
    return Pair(without(image, regions, missing), image, caption)
