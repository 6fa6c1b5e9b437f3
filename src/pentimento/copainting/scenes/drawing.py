"""A composition as a picture: where its things stand, and their parts as pixels, in colour or as black lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.copainting.scenes.compositions import COLORS, GROUNDS, Arrangement, Composition
from pentimento.copainting.scenes.things import DRAWINGS, Part, Tone

_FINER: Final = 4
"""Pictures are drawn so many times finer and averaged."""
_TONES: Final[dict[Tone, float]] = {"own": 0.0, "dark": -0.5, "light": 0.45, "white": 0.9}
"""Of a part's colour: the way to black (negative) or to white."""
_OUTLINE: Final = 0.014
"""Width of the contour around each part, of the picture's side."""

_PLACES: Final[dict[Arrangement, tuple[tuple[float, float], ...]]] = {
    "alone": ((0.5, 0.5),),
    "beside": ((0.27, 0.52), (0.73, 0.52)),
    "above": ((0.5, 0.27), (0.5, 0.74)),
    "row": ((0.19, 0.52), (0.5, 0.52), (0.81, 0.52)),
    "over_two": ((0.5, 0.26), (0.27, 0.74), (0.73, 0.74)),
}
"""Centres, of the picture's side, x to the right and y down."""
_SIZES: Final[dict[Arrangement, tuple[float, float]]] = {
    "alone": (0.58, 0.88),
    "beside": (0.43, 0.5),
    "above": (0.43, 0.49),
    "row": (0.32, 0.36),
    "over_two": (0.4, 0.46),
}
"""Smallest and largest side of a thing's square."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A thing in its place: its parts in units of the picture's side, and its colour."""

    parts: tuple[Part, ...]
    srgb: NDArray[np.float64]
    """[3], 0..255."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A scene ready to be drawn at any size."""

    things: tuple[Placed, ...]
    upper: NDArray[np.float64]
    lower: NDArray[np.float64]
    """sRGB of the ground's parts, 0..255."""
    horizon: float
    """Of the picture's side, from the top."""


def arrange(composition: Composition, generator: np.random.Generator) -> Drawing:
    """Every thing in its place, each a little different in size, place, slant, proportions and colour."""
    things = []
    places, sizes = _PLACES[composition.arrangement], _SIZES[composition.arrangement]
    for thing, place in zip(composition.things, places, strict=True):
        size = generator.uniform(*sizes)
        execution_noise = 0.025 if len(places) > 1 else (1 - size) / 2
        centre = np.array(place) + generator.uniform(-execution_noise, execution_noise, 2)
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
    """The picture sRGB [side, side, 3] and its regions [side, side]: 0 the ground, i + 1 thing i."""
    side = side_px * _FINER
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
    return _averaged(image, side_px), np.ascontiguousarray(regions[_FINER // 2 :: _FINER, _FINER // 2 :: _FINER])


def draw_lines(drawing: Drawing, side_px: int, width_px: float) -> NDArray[np.uint8]:
    """The things' outlines as a black pen would draw them on white, sRGB [side, side, 3]; the ground stays blank.

    Args:
        width_px: of the pen, in the picture's pixels.
    """
    side = side_px * _FINER
    image = np.full((side, side, 3), 255, np.uint8)
    pen = max(1, round(width_px * _FINER))
    white, black = (255.0, 255.0, 255.0), (0.0, 0.0, 0.0)
    for thing in drawing.things:
        for part in thing.parts:
            if part.width > 0:  # a bar of its own width, hollow where that leaves room
                points, width = _pixels(part.points, side), max(pen, round(part.width * side))
                cv2.polylines(image, [points], False, black, width)
                if width > 2 * pen:
                    cv2.polylines(image, [points], False, white, width - 2 * pen)
            else:
                _draw(image, part, white, black, pen)
    return _averaged(image, side_px)


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
    """[2, 2]: a small turn and shear, other proportions, and mirrored or not."""
    turn, stretch = np.radians(generator.uniform(-9, 9)), generator.uniform(0.88, 1.12)
    shear, mirrored = generator.uniform(-0.08, 0.08), generator.choice([-1.0, 1.0])
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return np.asarray(turned @ np.array([[mirrored * stretch**0.5, shear], [0, stretch**-0.5]]))


def _bent(points: NDArray[np.float64], bend: float, phase: float) -> NDArray[np.float64]:
    """A slow wave through a drawing, as a hand leaves it."""
    return points + bend * np.sin(2 * np.pi * points[:, ::-1] + phase)


def _jittered(srgb: tuple[int, int, int], generator: np.random.Generator) -> NDArray[np.float64]:
    return np.clip(np.array(srgb) + generator.normal(0, 6, 3), 0, 255)


def _toned(srgb: NDArray[np.float64], tone: float) -> tuple[float, ...]:
    toned = srgb * (1 + tone) if tone < 0 else srgb + (255 - srgb) * tone
    return tuple(float(value) for value in toned)
