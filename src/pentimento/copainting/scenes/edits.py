"""Ordinary edits of scenes: pairs of a picture that lacks something and the picture that has it.

They teach a goal planner's base what pictures show and that a request adds to what is there, before it meets anything
that a robot made. The thesis starts from Instruct-Pix2Pix, which was trained on a million such edits (6.4.2). Some are
in the scenes' colours, others as people draw with a pen; the request names the whole picture or what is missing.
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
from pentimento.copainting.scenes.collage import pairs_shown, put, random_halves
from pentimento.copainting.scenes.pen import pen_drawing, random_pen
from pentimento.copainting.scenes.phrases import listed, phrase

_BLANK_SHARE: Final = 0.3  # of the edits: all things are missing
_PAPER_SHARE: Final = 0.3  # of those in colour: the ground, too; a sheet of white paper
_PEN_SHARE: Final = 0.75  # of the edits: drawn with a pen
_COLLAGE_SHARE: Final = 0.9  # of the scenes with one thing: another's is beside or above it
_MISSING_SHARE: Final = 0.6  # of the requests: they name what is missing, not the whole picture
_TRIES: Final = 20
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


@dataclass(frozen=True, eq=False)
class _Shown:
    """A picture, what is on it, and what one says of the whole."""

    image: NDArray[np.uint8]
    regions: NDArray[np.uint8]
    """[H, W]: 0 the ground, i + 1 thing i."""
    kinds: tuple[str, ...]
    """Of the things, by label; empty where the table does not tell."""
    colors: tuple[str, ...]
    captions: tuple[str, ...]


def scene_edits(scenes: pa.Table, variants: int, seed: int) -> list[Pair]:
    """`variants` edits of each scene in a checked `scenes` table; row i's depend on the table and (seed, i) only.

    The target is the scene, or the scene's only thing beside that of another scene whose kind some scene of the table
    shows together with it: what the table holds out is not put together. The input lacks one or more of the things,
    which the ground replaces, or is blank.

    Raises:
        ContractError: the pictures differ in size, or a mask's size is not its picture's.
    """
    shown = [_shown(row, index) for index, row in enumerate(scenes.to_pylist())]
    together = pairs_shown(each.kinds for each in shown)
    alone = [number for number, each in enumerate(shown) if len(each.kinds) == 1]
    pairs = []
    for index, each in enumerate(shown):
        for variant in range(variants):
            generator = np.random.default_rng([seed, index, variant])
            if len(each.kinds) == 1 and generator.random() < _COLLAGE_SHARE:
                picks = [shown[alone[pick]] for pick in generator.integers(len(alone), size=_TRIES)]
                fitting = [pick for pick in picks if frozenset(pick.kinds + each.kinds) in together]
                pairs.append(_edit(_collage(each, fitting[0], generator) if fitting else each, generator))
            else:
                pairs.append(_edit(each, generator))
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


def _shown(row: dict[str, Any], index: int) -> _Shown:
    image, regions = decode_png(row["image"]["bytes"]), decode_png(row["regions"]["bytes"])
    if regions.shape != image.shape[:2]:
        raise ContractError(f"Scene {index}'s regions are {regions.shape}, its image {image.shape[:2]}; match them.")
    kinds, colors = (tuple(str(word) for word in row.get(name) or ()) for name in ("objects", "colors"))
    return _Shown(image, regions, kinds, colors, tuple(row.get("captions") or [row["caption"]]))


def _collage(one: _Shown, other: _Shown, generator: np.random.Generator) -> _Shown:
    """The things of two scenes on the ground of the first."""
    image = without(one.image, one.regions, np.unique(one.regions[one.regions > 0]))
    regions = np.zeros_like(one.regions)
    for label, (each, half) in enumerate(zip((one, other), random_halves(generator), strict=True), 1):
        image, there = put(image, each.image, each.regions, half, generator)
        regions[there] = label
    return _Shown(image, regions, one.kinds + other.kinds, one.colors + other.colors, ())


def _edit(shown: _Shown, generator: np.random.Generator) -> Pair:
    image, regions = shown.image, shown.regions
    labels = np.unique(regions[regions > 0])
    missing = labels
    if labels.size > 1 and generator.random() >= _BLANK_SHARE:
        missing = np.sort(generator.permutation(labels)[: int(generator.integers(1, labels.size))])
    if generator.random() < _PEN_SHARE:
        pen = random_pen(generator)
        before, after = (
            pen_drawing(image, np.isin(regions, kept), pen) for kept in (np.setdiff1d(labels, missing), labels)
        )
        return Pair(before, after, _request(shown, missing, False, generator))
    caption = _request(shown, missing, True, generator)
    if missing.size == labels.size and generator.random() < _PAPER_SHARE:
        return Pair(np.full_like(image, _PAPER_SRGB), image, caption)
    return Pair(without(image, regions, missing), image, caption)


def _request(shown: _Shown, missing: NDArray[np.integer], colored: bool, generator: np.random.Generator) -> str:
    """Words for the whole picture or, where it is known what things are, for what is missing; a pen has no colours."""
    named = bool(shown.kinds) and int(missing.max(initial=0)) <= len(shown.kinds)
    if named and (not shown.captions or generator.random() < _MISSING_SHARE):
        with_color = colored and bool(shown.colors) and generator.random() < 0.5
        things = [
            phrase(shown.kinds[label - 1], shown.colors[label - 1] if with_color else None)
            for label in missing
        ]  # fmt: skip
        return listed([things[number] for number in generator.permutation(len(things))])
    said = shown.captions
    if not colored:
        said = tuple(caption for caption in said if not set(shown.colors) & set(caption.split())) or said
    return said[int(generator.integers(len(said)))]
