"""Scenes of one to four named things: their arrangement, captions, split, and pictures in ink or in colour.

Things overlap: a thing in front hides what is behind it, in ink as in colour. A picture can show any of a scene's
things, so that a begun canvas holds whole drawings and not what a mask left of them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.scenes import WITHOUT_ARTICLE, phrase
from pentimento.copainting.drawings.sources import SIDE_PX, Source, named_drawing, vocabulary

Medium = Literal["marker", "colour"]
Places = Literal["usual", "anywhere"]
"""Where things stand: `usual` is the middle of each range, upright, the same for all scenes of a relation; a single
thing is large and centred. `anywhere` is random, slightly turned, some of it on a ground line.
"""
Relation = Literal["alone", "count", "beside", "above", "on", "behind", "inside", "row", "over_two", "four"]
FloatArray = NDArray[np.float64]

RELATION_SHARES: Final[dict[Relation, float]] = {
    "alone": 0.34, "count": 0.08, "beside": 0.2, "above": 0.12, "on": 0.06, "behind": 0.06, "inside": 0.03,
    "row": 0.04, "over_two": 0.04, "four": 0.03,
}  # fmt: skip

_SENTENCES: Final[dict[Relation, tuple[str, ...]]] = {
    "alone": ("{a}", "{a}", "{a}", "just {a}"),
    "count": ("{count} {a_plural}",),
    "beside": (
        "{a} beside {b}", "{b} beside {a}", "{a} next to {b}", "{b} next to {a}", "{a} to the left of {b}",
        "{b} to the right of {a}", "{a} and {b} side by side", "{a} and {b}",
    ),
    "above": ("{a} above {b}", "{a} over {b}", "{b} below {a}", "{b} under {a}", "{b} with {a} above it"),
    "on": ("{a} on {b}", "{a} on top of {b}", "{b} with {a} on it"),
    "behind": ("{a} behind {b}", "{b} in front of {a}", "{b} before {a}"),
    "inside": ("{a} inside {b}", "{a} in {b}", "{b} with {a} in it"),
    "row": ("{a}, {b} and {c} in a row", "{b} between {a} and {c}", "{a}, {b} and {c}"),
    "over_two": ("{a} above {b} and {c}", "{b} and {c} below {a}", "{a} over {b} and {c}"),
    "four": ("{a}, {b}, {c} and {d}", "{a} and {b} above {c} and {d}"),
}  # fmt: skip
_OPENINGS: Final = ("", "", "", "", "a picture of ", "a drawing of ", "please draw ")
_COUNTS: Final = {2: "two", 3: "three", 4: "four"}
_SYNONYM_SHARE: Final = 0.25  # of the mentions of a noun that has synonyms
_TURN_RAD: Final = np.radians(3)  # standard deviation of a thing's rotation
_GROUND_SHARE: Final = 0.2  # of the scenes: a ground line under the things
_TEST_IN: Final = 12  # one of so many pairs of nouns, and of nouns in a relation, is for testing only
WHITE: Final = (250, 250, 247)
"""sRGB of a sheet of white paper, for colours."""
_TINTS: Final = ((232, 240, 246), (246, 236, 222), (226, 236, 214), (236, 236, 238))
_TINTED_SHARE: Final = 2 / 3  # of the scenes: the sheet of colour has a pale tint
_GROUND_SRGB: Final = (150, 140, 120)
_LINES: Final = (0.018, 0.022)  # range of `DrawnScene.line`: a marker of 2 mm on about 100 mm
_LARGE: Final = 0.875  # size of a single thing in its usual place, in sides of the sheet
_LINE_OF_SOURCE: Final[Mapping[Source, float]] = {
    "openmoji": 0.03,
    "tabler": 0.045,
    "fluent": 0.06,
    "emojione_monotone": 0.045,
    "lucide": 0.045,
    "phosphor": 0.055,
    "icon_park": 0.045,
    "hugeicons": 0.045,
}
"""Width of a source's lines in sides of a drawing's square; measured on drawings that fill it."""


@dataclass(frozen=True)
class Placed:
    """A thing in its place on the sheet."""

    noun: str
    source: Source
    x: float
    """Of its centre, in sides of the sheet, to the right."""
    y: float
    """Down."""
    size: float
    """Of its square, in sides of the sheet."""
    turn_rad: float
    """Clockwise on the sheet."""
    mirrored: bool
    line: float = 0.0
    """Minimum width of a pen's lines, in sides of the sheet, where the scene's is less."""


@dataclass(frozen=True)
class DrawnScene:
    """Things from back to front, and how a caption names them."""

    relation: Relation
    things: tuple[Placed, ...]
    named: tuple[int, ...]
    """Indices of `things` in the order of the caption's letters a, b, c, d."""
    ground_y: float | None
    """Of the ground line, in sides of the sheet, down; None without one."""
    sheet_srgb: tuple[int, int, int]
    """Of the sheet in colour; a marker's sheet is white."""
    line: float
    """Minimum width of a pen's lines, in sides of the sheet."""


def split_of_scene(relation: Relation, nouns: Collection[str]) -> str:
    """`test` for held-out pairs of nouns and held-out relations of a noun; every other scene is `train`.

    The choice depends on the words alone. A noun alone is never held out.
    """
    if relation == "alone":
        return "train"
    keys = [f"{relation}:{noun}" for noun in set(nouns)] if relation != "beside" else []
    keys += [f"{a}+{b}" for a in nouns for b in nouns if a < b]
    return "test" if any(_digest(key) % _TEST_IN == 0 for key in keys) else "train"


def draw_scene(
    split: str,
    nouns: Sequence[str],
    source: Source,
    *,
    alone_share: float = RELATION_SHARES["alone"],
    mirrored_share: float = 0.0,
    tinted_share: float = _TINTED_SHARE,
    places: Places = "anywhere",
    generator: np.random.Generator,
) -> DrawnScene:
    """A random scene of `split` with things of `nouns`, which `source` draws.

    `alone_share` of the scenes show one thing, whatever `split` is; the other relations keep their proportions.
    `mirrored_share` of the things are mirrored. In colour, `tinted_share` of the scenes have a sheet with a pale tint.
    """
    scale = (1 - alone_share) / (1 - RELATION_SHARES["alone"])
    shares = {name: alone_share if name == "alone" else scale * share for name, share in RELATION_SHARES.items()}
    while True:
        relation = list(shares)[generator.choice(len(shares), p=list(shares.values()))]
        scene = _arranged(relation, nouns, source, mirrored_share=mirrored_share, where=places, generator=generator)
        if generator.random() < tinted_share:
            scene = replace(scene, sheet_srgb=_TINTS[int(generator.integers(len(_TINTS)))])
        if relation == "alone" or split_of_scene(relation, [thing.noun for thing in scene.things]) == split:
            return scene


def _arranged(
    relation: Relation,
    nouns: Sequence[str],
    source: Source,
    *,
    mirrored_share: float,
    where: Places,
    generator: np.random.Generator,
) -> DrawnScene:
    def u(low: float = 0.0, high: float = 1.0) -> float:
        return (low + high) / 2 if where == "usual" else float(generator.uniform(low, high))

    places: list[tuple[float, float, float]]  # x, y, size
    match relation:
        case "alone":
            size = _LARGE if where == "usual" else u(0.45, 0.92)
            places = [(u(size / 2, 1 - size / 2), u(size / 2, 1 - size / 2), size)]
        case "count":
            count = int(generator.integers(2, 5))
            size = u(0.36, 0.44) if count > 2 else u(0.42, 0.5)
            spots = {2: [(0.27, 0.5), (0.73, 0.5)], 3: [(0.5, 0.27), (0.26, 0.73), (0.74, 0.73)]}.get(
                count, [(0.27, 0.27), (0.73, 0.27), (0.27, 0.73), (0.73, 0.73)]
            )
            places = [(x, y, size) for x, y in spots]
        case "beside":
            gap, y = u(0.42, 0.52), u(0.35, 0.65)
            x = u(0.24, 0.76 - gap)
            places = [(x, y, u(0.36, 0.52)), (x + gap, y + u(-0.06, 0.06), u(0.36, 0.52))]
        case "above":
            gap, x = u(0.42, 0.52), u(0.35, 0.65)
            y = u(0.24, 0.76 - gap)
            places = [(x, y, u(0.36, 0.5)), (x + u(-0.06, 0.06), y + gap, u(0.36, 0.5))]
        case "on":
            low, high = u(0.5, 0.62), u(0.3, 0.38)
            y = 0.97 - low / 2
            places = [(0.5 + u(-0.05, 0.05), y - low / 2 - high * 0.42, high), (0.5, y, low)]
        case "behind":
            side = 1 if u() < 0.5 else -1
            places = [
                (0.5 + 0.13 * side, u(0.36, 0.44), u(0.5, 0.62)),
                (0.5 - 0.13 * side, u(0.58, 0.66), u(0.45, 0.58)),
            ]
        case "inside":
            places = [(0.5, 0.52, u(0.3, 0.38)), (0.5, 0.5, u(0.85, 0.95))]
        case "row":
            places = [(x, 0.5 + u(-0.06, 0.06), u(0.29, 0.34)) for x in (0.18, 0.5, 0.82)]
        case "over_two":
            places = [(x, y, u(0.38, 0.46)) for x, y in ((0.5, 0.25), (0.26, 0.74), (0.74, 0.74))]
        case "four":
            places = [(x, y, u(0.36, 0.44)) for x, y in ((0.26, 0.26), (0.74, 0.26), (0.26, 0.74), (0.74, 0.74))]
    picks = generator.choice(len(nouns), 1 if relation == "count" else len(places), replace=False)
    names = [nouns[int(pick)] for pick in picks] * (len(places) if relation == "count" else 1)
    things = tuple(
        Placed(name, source, x, y, size, _turn(where, generator), bool(u() < mirrored_share))
        for name, (x, y, size) in zip(names, places, strict=True)
    )
    named = tuple(range(len(things)))
    if relation == "inside":  # the container is behind
        things, named = things[::-1], named[::-1]
    ground = None
    if where == "anywhere" and u() < _GROUND_SHARE and relation in ("alone", "beside", "row", "on"):
        ground = max(thing.y + 0.5 * thing.size for thing in things) - u(0.01, 0.05)
    ground = ground if ground is not None and ground < 0.97 else None
    return DrawnScene(relation, things, named, ground, WHITE, float(u(*_LINES)))


def _turn(where: Places, generator: np.random.Generator) -> float:
    return float(generator.normal(0, _TURN_RAD)) if where == "anywhere" else 0.0


def caption(scene: DrawnScene, generator: np.random.Generator) -> str:
    """One wording of the whole scene."""
    order = [scene.things[index].noun for index in scene.named]
    words = [_word(noun, generator) for noun in order]
    sentences = _SENTENCES[scene.relation]
    sentence = sentences[int(generator.integers(len(sentences)))]
    fields = {letter: phrase(word) for letter, word in zip("abcd", words, strict=False)}
    opening = "" if sentence.startswith("just") else str(generator.choice(_OPENINGS))
    return opening + sentence.format(**fields, a_plural=plural(words[0]), count=_COUNTS.get(len(order), ""))


def plural(word: str) -> str:
    """The plural of an English noun of the vocabulary; a word for a pair or a substance stays as it is."""
    *before, last = word.split(" ")
    if word in WITHOUT_ARTICLE or last in _UNCHANGED:
        return word
    if last in _IRREGULAR:
        last = _IRREGULAR[last]
    elif last.endswith(("s", "x", "ch", "sh")):
        last += "es"
    elif last.endswith("y") and last[-2] not in "aeiou":
        last = last[:-1] + "ies"
    else:
        last += "s"
    return " ".join([*before, last])


_UNCHANGED: Final = {"fish", "sheep", "deer", "moose", "shrimp", "squid", "elk"}
_IRREGULAR: Final = {
    "mouse": "mice", "goose": "geese", "tooth": "teeth", "knife": "knives", "wolf": "wolves", "leaf": "leaves",
    "scarf": "scarves", "loaf": "loaves",
}  # fmt: skip


def _word(noun: str, generator: np.random.Generator) -> str:
    synonyms = vocabulary()[noun].synonyms
    if synonyms and generator.random() < _SYNONYM_SHARE:
        return synonyms[int(generator.integers(len(synonyms)))]
    return noun


@dataclass(frozen=True, eq=False)
class Rendered:
    """Some of a scene's things on a sheet."""

    image: NDArray[np.uint8]
    """sRGB [side, side, 3]."""
    regions: NDArray[np.uint8]
    """[side, side]: i + 1 where thing i is in front, 0 for the sheet."""


def render_scene(
    scene: DrawnScene, shown: Collection[int], medium: Medium, *, side_px: int, archives: Path | None = None
) -> Rendered:
    """The things `shown` (indices) of a scene: black lines on white for a marker, painted things in colour.

    `archives` as for `named_drawing`. A marker draws only things of sources with pen drawings.
    """
    canvas = np.empty((side_px, side_px, 3))
    canvas[:] = 255.0 if medium == "marker" else scene.sheet_srgb
    regions = np.zeros((side_px, side_px), np.uint8)
    if scene.ground_y is not None:
        rows = np.abs(np.arange(side_px) + 0.5 - scene.ground_y * side_px)[:, None, None]
        cover = np.clip(scene.line * side_px / 2 + 0.5 - rows, 0, 1)
        canvas += cover * ((0.0 if medium == "marker" else np.array(_GROUND_SRGB)) - canvas)
    for index in sorted(shown):
        thing = scene.things[index]
        drawing = named_drawing(thing.noun, thing.source, archives)
        ink = drawing.ink
        if medium == "marker":
            ink = _widened(ink, _LINE_OF_SOURCE[thing.source], max(scene.line, thing.line) / thing.size)
        layers = _warped(np.dstack([ink, drawing.painting]), thing, side_px)
        lines, alpha = layers[..., :1] / 255, layers[..., 4:] / 255
        if medium == "marker":
            canvas = (canvas * (1 - alpha) + 255 * alpha) * (1 - lines)
        else:
            canvas = canvas * (1 - alpha) + layers[..., 1:4]
        regions[np.maximum(lines, alpha)[..., 0] >= 0.5] = index + 1
    return Rendered(np.round(canvas).astype(np.uint8), regions)


def _widened(ink: NDArray[np.uint8], width: float, wanted: float) -> NDArray[np.uint8]:
    """Lines of a `width` made as wide as `wanted`, if they are thinner; both in sides of the drawing's square."""
    grow = round((wanted - width) * SIDE_PX)
    if grow < 1:
        return ink
    pen = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (grow + 1, grow + 1))
    return np.asarray(cv2.dilate(ink, pen), dtype=np.uint8)


def _warped(layers: NDArray[np.uint8], thing: Placed, side_px: int) -> FloatArray:
    """Layers [S, S, C] of a drawing in the place of a thing on a sheet, [side, side, C].

    They are shrunk by area first, because a warp alone would skip lines.
    """
    extent = thing.size * side_px
    small = max(8, round(extent))
    layers = np.dstack([cv2.resize(layers[..., i : i + 4], (small, small), interpolation=cv2.INTER_AREA)
                        for i in range(0, layers.shape[2], 4)])  # fmt: skip
    scale = extent / small
    cos, sin = scale * np.cos(thing.turn_rad), scale * np.sin(thing.turn_rad)
    matrix = np.array([[cos, -sin], [sin, cos]]) @ np.diag([-1.0 if thing.mirrored else 1.0, 1.0])
    # OpenCV's pixel centres are at whole numbers.
    shift = np.array([thing.x, thing.y]) * side_px - 0.5 - matrix @ np.full(2, (small - 1) / 2)
    moved = np.column_stack([matrix, shift])
    parts = [
        cv2.warpAffine(np.ascontiguousarray(layers[..., i : i + 4]), moved, (side_px, side_px), flags=cv2.INTER_LINEAR)
        for i in range(0, layers.shape[2], 4)
    ]
    return np.dstack(parts).astype(np.float64)


def _digest(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")
