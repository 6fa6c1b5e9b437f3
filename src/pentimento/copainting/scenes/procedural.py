"""Procedurally drawn scenes with captions and regions: the data that co-painting starts from if none is imported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.images import image_cell
from pentimento.contracts.ranges import at_least
from pentimento.contracts.scenes import CONTRACT, split_of
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.scenes.compositions import (
    COLORS,
    GROUNDS,
    Arrangement,
    Composition,
    Splits,
    compose,
    wordings,
)
from pentimento.copainting.scenes.things import DRAWINGS, Part, Tone

_SUPERSAMPLING: Final = 4
"""Pictures are rasterised at this many times their size and averaged down."""
_TONES: Final[dict[Tone, float]] = {"own": 0.0, "dark": -0.5, "light": 0.45, "white": 0.9}
"""Shift of a part's colour towards black (negative) or white (positive), as a fraction."""
_OUTLINE: Final = 0.014
"""Width of the contour around each part, in sides of the picture."""

_PLACES: Final[dict[Arrangement, tuple[tuple[float, float], ...]]] = {
    "alone": ((0.5, 0.5),),
    "beside": ((0.27, 0.52), (0.73, 0.52)),
    "above": ((0.5, 0.27), (0.5, 0.74)),
    "row": ((0.19, 0.52), (0.5, 0.52), (0.81, 0.52)),
    "over_two": ((0.5, 0.26), (0.27, 0.74), (0.73, 0.74)),
}
"""Centres in sides of the picture, x to the right and y down."""
_SIZES: Final[dict[Arrangement, tuple[float, float]]] = {
    "alone": (0.58, 0.88),
    "beside": (0.43, 0.5),
    "above": (0.43, 0.49),
    "row": (0.32, 0.36),
    "over_two": (0.4, 0.46),
}
"""Range of the side of a thing's square, in sides of the picture."""

SOURCE: Final = "drawn by pentimento"
LICENCE: Final = "CC0-1.0"


@dataclass(frozen=True, eq=False)
class Placed:
    """A thing in its place."""

    parts: tuple[Part, ...]
    """In sides of the picture."""
    srgb: NDArray[np.float64]
    """[3], 0 to 255."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A scene that can be rasterised at any size."""

    things: tuple[Placed, ...]
    upper: NDArray[np.float64]
    lower: NDArray[np.float64]
    """sRGB of the upper and the lower part of the background, [3] each, 0 to 255."""
    horizon: float
    """Where the parts meet, from the top, in sides of the picture."""


def arrange(composition: Composition, generator: np.random.Generator) -> Drawing:
    """Place each thing with random variations of size, position, rotation, proportions and colour."""
    things = []
    places, sizes = _PLACES[composition.arrangement], _SIZES[composition.arrangement]
    for thing, place in zip(composition.things, places, strict=True):
        size = generator.uniform(*sizes)
        offset = 0.025 if len(places) > 1 else (1 - size) / 2
        centre = np.array(place) + generator.uniform(-offset, offset, 2)
        matrix = _slanted(generator) * size
        bend, phase = generator.uniform(0, 0.03), generator.uniform(0, 2 * np.pi)
        parts = tuple(
            Part((_bent(part.points, bend, phase) - 0.5) @ matrix.T + centre, part.tone, part.width * size)
            for part in DRAWINGS[thing.kind]
        )
        things.append(Placed(parts, _jittered(COLORS[thing.color], generator)))
    upper, lower = (_jittered(color, generator) for color in GROUNDS[composition.ground])
    return Drawing(tuple(things), upper, lower, generator.uniform(0.55, 0.78))


def paint(drawing: Drawing, side_px: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The picture, sRGB [side, side, 3], and its region labels [side, side]: 0 for the background, i + 1 for thing
    i."""
    side = side_px * _SUPERSAMPLING
    image = np.empty((side, side, 3), np.uint8)
    row = round(drawing.horizon * side)
    image[:row], image[row:] = drawing.upper, drawing.lower
    regions = np.zeros((side, side), np.uint8)
    outline = max(1, round(_OUTLINE * side))
    for label, thing in enumerate(drawing.things, 1):
        contour = _toned(thing.srgb, -0.65)
        for part in thing.parts:
            _draw(image, part, _toned(thing.srgb, _TONES[part.tone]), contour, outline)
            _draw(regions, part, (label,), (label,), outline)
    middle = slice(_SUPERSAMPLING // 2, None, _SUPERSAMPLING)  # the label at each pixel's centre
    return _averaged(image, side_px), np.ascontiguousarray(regions[middle, middle])


def _draw(
    image: NDArray[np.uint8], part: Part, fill: tuple[float, ...], contour: tuple[float, ...], outline_px: int
) -> None:
    side = image.shape[0]
    points = _pixels(part.points, side)
    if part.width > 0:
        width = max(1, round(part.width * side))
        cv2.polylines(image, [points], False, contour, width + outline_px)
        cv2.polylines(image, [points], False, fill, width)
    else:
        cv2.fillPoly(image, [points], fill)
        cv2.polylines(image, [points], True, contour, outline_px)


def _pixels(points: NDArray[np.float64], side: int) -> NDArray[np.int32]:
    return np.rint(points * side).astype(np.int32)


def _averaged(image: NDArray[np.uint8], side_px: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(image, (side_px, side_px), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _slanted(generator: np.random.Generator) -> NDArray[np.float64]:
    """[2, 2]: a small rotation and shear, a stretch, and a random reflection."""
    turn, stretch = np.radians(generator.uniform(-9, 9)), generator.uniform(0.88, 1.12)
    shear, mirrored = generator.uniform(-0.08, 0.08), generator.choice([-1.0, 1.0])
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return np.asarray(turned @ np.array([[mirrored * stretch**0.5, shear], [0, stretch**-0.5]]))


def _bent(points: NDArray[np.float64], bend: float, phase: float) -> NDArray[np.float64]:
    """A slow sinusoidal distortion, as in drawings by hand."""
    return points + bend * np.sin(2 * np.pi * points[:, ::-1] + phase)


def _jittered(srgb: tuple[int, int, int], generator: np.random.Generator) -> NDArray[np.float64]:
    return np.clip(np.array(srgb) + generator.normal(0, 6, 3), 0, 255)


def _toned(srgb: NDArray[np.float64], tone: float) -> tuple[float, ...]:
    toned = srgb * (1 + tone) if tone < 0 else srgb + (255 - srgb) * tone
    return tuple(float(value) for value in toned)


@dataclass(frozen=True)
class ScenesConfig:
    """How many scenes are drawn, and how."""

    scenes: int
    side_px: int
    val_share: float
    test_share: float
    wordings: int
    """Captions of each scene."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "scenes", "wordings")
        at_least(self, 16, "side_px")
        at_least(self, 0, "val_share", "test_share", "seed")
        if self.val_share + self.test_share >= 1:
            raise ValueError(
                f"val_share and test_share are {self.val_share} and {self.test_share}; leave a share for training."
            )


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene before it is rasterised."""

    split: str
    composition: Composition
    captions: list[str]
    drawing: Drawing


def draw_scene(item: int, config: ScenesConfig, splits: Splits) -> Scene:
    """Scene `item`; it depends on the seed and its number, not on how many scenes there are."""
    generator = np.random.default_rng([config.seed, 1, item])
    split = split_of(generator.random(), config.val_share, config.test_share)
    composition = compose(split, splits, generator)
    return Scene(
        split, composition, wordings(composition, config.wordings, generator), arrange(composition, generator)
    )  # fmt: skip


def build_scenes(config: ScenesConfig, log: Callable[[str, float, int], None]) -> pa.Table:
    """All scenes as a table of the `scenes` contract, in the order of their numbers."""
    splits = Splits(config.seed)
    rows = []
    for item in range(config.scenes):
        rows.append(_row(item, draw_scene(item, config, splits), config.side_px))
        if (item + 1) % 1000 == 0:
            log("scenes", item + 1, item + 1)
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def _row(item: int, scene: Scene, side_px: int) -> dict[str, Any]:
    image, regions = paint(scene.drawing, side_px)
    return {
        "image": image_cell(image),
        "caption": scene.captions[0],
        "regions": image_cell(regions),
        "source": SOURCE,
        "licence": LICENCE,
        "scene_id": f"scene_{item:06d}",
        "split": scene.split,
        "captions": scene.captions,
        "objects": [thing.kind for thing in scene.composition.things],
        "colors": [thing.color for thing in scene.composition.things],
        "arrangement": scene.composition.arrangement,
        "ground": scene.composition.ground,
    }
