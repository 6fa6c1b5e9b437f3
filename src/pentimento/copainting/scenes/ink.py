"""Pictures in one ink: ink tones of a picture, pen drawings, random strokes, and the recall of ink."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.ranges import above_zero, at_least

REACH_PX: Final = 1
"""Ink that moved by at most this distance counts as kept."""

FloatArray = NDArray[np.float64]
_SURROUND: Final = 4.0
"""Width of the Gaussian of the surroundings, as a multiple of that of the line."""
_LUMINANCE: Final = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB (IEC 61966-2-1)
_PEN_SUPERSAMPLING: Final = 2  # drawn at this many times the size and averaged down
_PEN_REACH_PX: Final = 2  # of a contour beyond the mask of what is drawn
_STROKE_SUPERSAMPLING: Final = 4  # drawn at this many times the size and averaged down: soft edges at any width
_SHIFT: Final = 4  # OpenCV's fixed-point bits of a coordinate
_DARK_SHARE: Final = 0.7  # of the pictures; the others have one ink of any colour


def ink_mask(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The inked pixels [..., H, W] of drawings [..., H, W, 3]: those darker than half of white in sRGB grey."""
    grey: NDArray[np.bool_] = picture.astype(np.float32).mean(-1) < 127.5
    return grey


def ink_recall(drawing: NDArray[np.uint8], picture: NDArray[np.uint8], reach_px: int = REACH_PX) -> float:
    """The fraction of a drawing's ink that a picture shows within `reach_px`; NaN if the drawing has no ink.

    Both are uint8 [H, W, 3], or [B, H, W, 3] for the fraction over all ink of a batch.
    """
    before, after = (ink_mask(np.atleast_3d(p)).reshape(-1, *p.shape[-3:-1]) for p in (drawing, picture))
    reach = np.ones((2 * reach_px + 1, 2 * reach_px + 1), np.uint8)
    near = np.stack([cv2.dilate(mask.astype(np.uint8), reach) for mask in after]).astype(bool)
    inked = int(before.sum())
    return float((before & near).sum() / inked) if inked else float("nan")


@dataclass(frozen=True)
class InkTones:
    """How a picture is converted to ink."""

    line_m: float
    """Standard deviation of the Gaussian that finds contours; about half the width of a pen's stroke."""
    contrast: float
    """Difference of lightness from the surroundings at which a contour is fully black; a lower value gives more
    contours.
    """
    tone: float
    """Fraction of the darkness of surfaces that is kept: 0 gives contours only, 1 the tones of the picture."""

    def __post_init__(self) -> None:
        above_zero(self, "line_m", "contrast")
        at_least(self, 0, "tone")
        if self.tone > 1:
            raise ValueError(f"tone is {self.tone}; it is a share, at most 1.")


def check_ink(ink: InkTones | None, has_ink: bool, owner: str, tool: str) -> None:
    """Raise `ConfigError` if ink tones are given for a tool without its own ink."""
    if ink is not None and not has_ink:
        raise ConfigError(f"{owner} has ink {ink!r}, but the {tool} has none: set ink to null.")


def ink_tones(picture: FloatArray, pixels_per_m: float, config: InkTones) -> FloatArray:
    """The target darkness of the ink as grey linear light [H, W, 3], for a picture [H, W, 3] in linear light.

    Contours are the dark side of a difference of Gaussians of lightness (Winnemöller, Kyprianidis and Olsen 2012), so
    that a few dozen strokes can show the content and a tinted background stays white. Lightness is stretched from its
    2nd to its 98th percentile, except in a picture of one tone.
    """
    lightness = linear_to_srgb(np.clip(picture @ _LUMINANCE, 0.0, 1.0))
    low, high = np.percentile(lightness, [2, 98])
    if high - low > 1e-3:
        lightness = np.clip((lightness - low) / (high - low), 0.0, 1.0)
    width_px = config.line_m * pixels_per_m
    near, far = (cv2.GaussianBlur(lightness, (0, 0), width) for width in (width_px, _SURROUND * width_px))
    contour = np.clip((far - near) / config.contrast, 0.0, 1.0)
    tones = np.minimum(1 - contour, 1 - config.tone * (1 - lightness))
    return np.repeat(srgb_to_linear(tones)[..., None], 3, axis=-1)


@dataclass(frozen=True)
class Pen:
    """The pen and style of a simulated writer."""

    width: float
    """Width of the lines, in sides of the picture."""
    contrast: float
    """As in `InkTones`."""
    tone: float
    """As in `InkTones`: 0 draws contours only."""
    ink: float
    """sRGB grey of the ink."""
    paper: float
    """sRGB grey of the paper."""


def random_pen(generator: np.random.Generator) -> Pen:
    """A random pen: thin to broad, black to dark grey; half of them shade."""
    tone = float(generator.uniform(0.1, 0.4)) if generator.random() < 0.5 else 0.0
    return Pen(
        float(generator.uniform(0.007, 0.011)), float(generator.uniform(0.1, 0.25)), tone,
        float(generator.uniform(0, 0.15)), float(generator.uniform(0.95, 1.0)),
    )  # fmt: skip


def pen_drawing(picture: NDArray[np.uint8], drawn: NDArray[np.bool_], pen: Pen) -> NDArray[np.uint8]:
    """A pen drawing of a picture, sRGB [H, W, 3], within the mask `drawn` [H, W] and its margin; the rest is paper."""
    height, width = picture.shape[:2]
    large = cv2.resize(
        picture, (width * _PEN_SUPERSAMPLING, height * _PEN_SUPERSAMPLING), interpolation=cv2.INTER_CUBIC
    )
    lit = srgb_to_linear(large.astype(np.float64) / 255)
    # On a sheet one metre wide, widths in metres are shares of the picture's side.
    tones = ink_tones(lit, float(width * _PEN_SUPERSAMPLING), InkTones(pen.width, pen.contrast, pen.tone))
    light = cv2.resize(linear_to_srgb(tones[..., 0]), (width, height), interpolation=cv2.INTER_AREA)
    near = cv2.dilate(drawn.astype(np.uint8), np.ones((2 * _PEN_REACH_PX + 1,) * 2, np.uint8)) > 0
    grey = pen.ink + (pen.paper - pen.ink) * np.where(near, light, 1.0)
    return np.repeat(np.round(255 * grey).astype(np.uint8)[..., None], 3, axis=-1)


def random_strokes(
    side_px: int, strokes: int, width_px: tuple[float, float], generator: np.random.Generator
) -> NDArray[np.uint8]:
    """Random arcs of one ink on light paper, sRGB [side, side, 3]; the width of each is uniform within `width_px`.

    They stand for whatever a robot's canvas may show.
    """
    size = side_px * _STROKE_SUPERSAMPLING
    cover = np.zeros((size, size), np.uint8)
    t = np.linspace(-1, 1, 16)[:, None]
    for _ in range(strokes):
        middle, angle = generator.uniform(0, side_px, 2), generator.uniform(0, np.pi)
        half, bend = generator.uniform(0.04, 0.25) * side_px, generator.normal(0, 0.15) * side_px
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        points = middle + along * t * half + across * (1 - t**2) * bend
        fixed_point = np.round(points * _STROKE_SUPERSAMPLING * 2**_SHIFT).astype(np.int32)
        width = max(1, round(generator.uniform(*width_px) * _STROKE_SUPERSAMPLING))
        cv2.polylines(cover, [fixed_point], False, 1, width, shift=_SHIFT)
    dark = generator.random() < _DARK_SHARE
    ink = np.full(3, generator.uniform(0, 0.2)) if dark else generator.uniform(0, 0.8, 3)
    paper = generator.uniform(0.88, 1.0)
    share = cv2.resize(cover.astype(np.float32), (side_px, side_px), interpolation=cv2.INTER_AREA)[..., None]
    return np.round(255 * (paper + (ink - paper) * share)).astype(np.uint8)
