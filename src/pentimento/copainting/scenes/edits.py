"""Edits of scenes: pairs of a picture that lacks something and the picture that shows it, with a request.

They pretrain the goal planner on what pictures show and on adding to an existing picture, before it sees any painting
of a robot. The thesis starts from Instruct-Pix2Pix, which was trained on a million edits (6.4.2). Some edits are in the
colours of the scenes, others are pen drawings. The request names the whole picture or the missing things.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.contracts.requests import COLOUR_WORDS, MARKER_WORDS, with_medium
from pentimento.contracts.scenes import labels_of, listed, phrase, read_scene, without_colors
from pentimento.copainting.scenes.collage import PAPER_SRGB, pairs_in_training, put, random_halves, without
from pentimento.copainting.scenes.ink import pen_drawing, random_pen

_BLANK_SHARE: Final = 0.3  # of the edits of scenes with several objects: all objects are missing
_PAPER_SHARE: Final = 0.3  # of the blank edits in colour: the input is white paper, without the background
_PEN_SHARE: Final = 0.75  # of the edits: pen drawings
_COLLAGE_SHARE: Final = 0.9  # of the scenes with one object: combined with another scene's object
_MISSING_SHARE: Final = 0.6  # of the requests: they name the missing objects, not the whole picture
_TRIES: Final = 20  # scenes drawn to find one that may be combined with a given scene
_HOLD_OUT_EVERY: Final = 10  # scenes, where the table has no split


@dataclass(frozen=True, eq=False)
class Pair:
    """An input of the goal planner, its target and its caption."""

    input: NDArray[np.uint8]
    """sRGB [H, W, 3]."""
    target: NDArray[np.uint8]
    """sRGB [H, W, 3]."""
    caption: str


@dataclass(frozen=True, eq=False)
class _Shown:
    """A picture with its regions and captions."""

    image: NDArray[np.uint8]
    regions: NDArray[np.uint8]
    """[H, W]: 0 for the background, i + 1 for thing i."""
    kinds: tuple[str, ...]
    """Of the things, by label; empty if the table has none."""
    colors: tuple[str, ...]
    captions: tuple[str, ...]
    pen: NDArray[np.uint8] | None
    """The picture as a pen drawing; None if one must be made of it."""


def scene_edits(scenes: pa.Table, variants: int, seed: int) -> list[Pair]:
    """`variants` edits of each scene of a checked `scenes` table; those of row i depend on the table and (seed, i)
    only.

    The target is the scene itself, or its only thing beside that of another scene. Two kinds are combined only if a
    scene of the table shows both, so held-out pairs stay held out. In the input, one or more things are replaced by the
    background, or the picture is blank.

    Raises:
        ContractError: the pictures differ in size, or a mask's size is not its picture's.
    """
    shown = [_shown(row, index) for index, row in enumerate(scenes.to_pylist())]
    together = pairs_in_training(scenes)
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
    """The co-paintings of one split as pairs of a partial and a full painting (thesis 6.4.1). The request names the
    medium, where the table does.
    """
    named = "medium" in copaintings.column_names
    chosen = copaintings.filter(pa.array([name == split for name in copaintings["split"].to_pylist()], pa.bool_()))
    return [
        Pair(
            decode_png(row["partial"]["bytes"]),
            decode_png(row["full"]["bytes"]),
            with_medium(row["caption"], row["medium"]) if row.get("medium") else row["caption"],
        )
        for row in chosen.select(["partial", "full", "caption", *(["medium"] if named else [])]).to_pylist()
    ]


def scenes_of(scenes: pa.Table, split: str) -> pa.Table:
    """The scenes of one split; in a table without splits, every tenth scene is `val` and the others are `train`."""
    if "split" in scenes.column_names and None not in (names := scenes["split"].to_pylist()):
        return scenes.filter(pa.array([name == split for name in names], pa.bool_()))
    held_out = [index % _HOLD_OUT_EVERY == 0 for index in range(scenes.num_rows)]
    return scenes.filter(pa.array([apart == (split == "val") for apart in held_out], pa.bool_()))


def _shown(row: dict[str, Any], index: int) -> _Shown:
    image, regions = read_scene(row, f"Scene {index}")
    kinds, colors = (tuple(str(word) for word in row.get(name) or ()) for name in ("objects", "colors"))
    pen = None if row.get("pen") is None else decode_png(row["pen"]["bytes"])
    return _Shown(image, regions, kinds, colors, tuple(row.get("captions") or [row["caption"]]), pen)


def _collage(one: _Shown, other: _Shown, generator: np.random.Generator) -> _Shown:
    """The things of two scenes on the background of the first."""
    image = without(one.image, one.regions, labels_of(one.regions))
    pen = None if one.pen is None or other.pen is None else np.full_like(one.pen, 255)
    regions = np.zeros_like(one.regions)
    for label, (each, half) in enumerate(zip((one, other), random_halves(generator), strict=True), 1):
        place = generator.integers(2**31)  # the same in both pictures
        image, there = put(image, each.image, each.regions, half=half, generator=np.random.default_rng(place))
        if pen is not None and each.pen is not None:
            pen = put(pen, each.pen, each.regions, half=half, generator=np.random.default_rng(place))[0]
        regions[there] = label
    return _Shown(image, regions, one.kinds + other.kinds, one.colors + other.colors, (), pen)


def _edit(shown: _Shown, generator: np.random.Generator) -> Pair:
    image, regions = shown.image, shown.regions
    labels = labels_of(regions)
    missing = labels
    if labels.size > 1 and generator.random() >= _BLANK_SHARE:
        missing = np.sort(generator.permutation(labels)[: int(generator.integers(1, labels.size))])
    if generator.random() < _PEN_SHARE:
        request = with_medium(_request(shown, missing, False, generator), MARKER_WORDS)
        if shown.pen is not None:
            return Pair(without(shown.pen, regions, missing), shown.pen, request)
        pen = random_pen(generator)
        before, after = (
            pen_drawing(image, np.isin(regions, kept), pen) for kept in (np.setdiff1d(labels, missing), labels)
        )
        return Pair(before, after, request)
    caption = with_medium(_request(shown, missing, True, generator), COLOUR_WORDS)
    if missing.size == labels.size and generator.random() < _PAPER_SHARE:
        return Pair(np.full_like(image, PAPER_SRGB), image, caption)
    return Pair(without(image, regions, missing), image, caption)


def _request(shown: _Shown, missing: NDArray[np.integer], colored: bool, generator: np.random.Generator) -> str:
    """A caption of the whole picture, or the names of the missing things where they are known; without colours for a
    pen.
    """
    named = bool(shown.kinds) and int(missing.max(initial=0)) <= len(shown.kinds)
    if named and (not shown.captions or generator.random() < _MISSING_SHARE):
        with_color = colored and bool(shown.colors) and generator.random() < 0.5
        things = [
            phrase(shown.kinds[label - 1], shown.colors[label - 1] if with_color else None)
            for label in missing
        ]  # fmt: skip
        return listed([things[number] for number in generator.permutation(len(things))])
    captions = shown.captions if colored else without_colors(shown.captions, shown.colors)
    return captions[int(generator.integers(len(captions)))]
