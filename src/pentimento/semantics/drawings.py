"""Drawing styles for training pictures: black contours, hatching, grey, short marker strokes and paint strokes.

An encoder trained on smooth pictures only does not recognise drawings. These styles approximate what a marker or a
brush leaves; they are computed from the picture alone.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Style = Literal["lines", "hatching", "grey", "strokes", "paint"]
STYLES: tuple[Style, ...] = ("lines", "hatching", "grey", "strokes", "paint")
_SUPERSAMPLING = 2
"""Lines are drawn at this many times the size and averaged down."""
_ROUNDS = 3
"""In which a marker's strokes are placed, each where the earlier ones have left contours uncovered."""
_DIRECTIONS = 10
"""Candidate directions of a stroke."""
_LENGTHS = np.array([0.08, 0.14, 0.24])
"""Candidate lengths of a marker's strokes, in sides of the picture."""
_MIN_CONTOUR = 0.45
"""Minimum fraction of contour under a stroke for it to be preferred to a shorter one."""


def draw(image: NDArray[np.uint8], style: Style, generator: np.random.Generator) -> NDArray[np.uint8]:
    """The picture, sRGB [H, W, 3], in a style; pen, paper and strokes vary with the generator."""
    height, width = image.shape[:2]
    size = (width * _SUPERSAMPLING, height * _SUPERSAMPLING)
    large = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    pen = generator.uniform(0.012, 0.035) * min(size)  # of 64 px: 0.8 to 2.2
    paper = tuple(float(v) for v in generator.uniform(225, 255) + generator.uniform(-6, 0, 3))
    canvas = np.empty_like(large)
    canvas[:] = paper
    match style:
        case "lines":
            _draw_contours(canvas, large, pen, generator=generator)
            if generator.random() < 0.3:
                _draw_tones(canvas, large, pen, strokes=int(generator.integers(10, 60)), generator=generator)
        case "hatching":
            _draw_tones(canvas, large, pen, strokes=int(generator.integers(60, 220)), generator=generator)
            if generator.random() < 0.5:
                _draw_contours(canvas, large, pen, generator=generator)
        case "grey":
            grey = cv2.GaussianBlur(cv2.cvtColor(large, cv2.COLOR_RGB2GRAY), (0, 0), generator.uniform(0.3, 2.0))
            canvas[:] = grey[..., None]
        case "strokes":
            _draw_strokes(canvas, large, generator)
        case "paint":
            _draw_colors(canvas, large, pen, generator=generator)
    small = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _ink(generator: np.random.Generator) -> tuple[float, ...]:
    return (float(generator.uniform(0, 70)),) * 3


def _draw_contours(
    canvas: NDArray[np.uint8], image: NDArray[np.uint8], pen: float, *, generator: np.random.Generator
) -> None:
    """Contours where colours change (Canny 1986, the strongest channel), in the width of the pen."""
    soft = cv2.GaussianBlur(image, (5, 5), generator.uniform(0.8, 1.6))
    high = generator.uniform(60, 200)
    edges = cv2.Canny(soft, 0.4 * high, high)
    wide = max(1, round(pen))
    edges = cv2.dilate(edges, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide)))
    canvas[edges > 0] = _ink(generator)


def _draw_tones(
    canvas: NDArray[np.uint8], image: NDArray[np.uint8], pen: float, *, strokes: int, generator: np.random.Generator
) -> None:
    """Short black strokes where the picture is dark or its colours change, along its contours or in one direction."""
    grey = cv2.cvtColor(cv2.GaussianBlur(image, (3, 3), 0.8), cv2.COLOR_RGB2GRAY).astype(np.float32)
    across, down = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    steep = np.hypot(across, down)
    high, spread = float(grey.max()), max(float(grey.max() - grey.min()), 1.0)
    want = ((high - grey) / spread) ** 2 + generator.uniform(0, 2) * steep / max(float(steep.max()), 1.0) + 1e-4
    summed = np.cumsum(want.ravel(), dtype=np.float64)
    places = np.searchsorted(summed, generator.random(strokes) * summed[-1]).clip(max=want.size - 1)
    rows, columns = np.divmod(places, want.shape[1])
    angles = np.arctan2(down[rows, columns], across[rows, columns]) + np.pi / 2
    if generator.random() < 0.4:
        angles = np.where(steep[rows, columns] > 40, angles, generator.uniform(0, np.pi))
    ends = _segments(columns, rows, angles, length=generator.uniform(2, 5) * pen, generator=generator)
    cv2.polylines(canvas, list(ends), False, _ink(generator), max(1, round(pen)), cv2.LINE_AA)


def _draw_strokes(canvas: NDArray[np.uint8], image: NDArray[np.uint8], generator: np.random.Generator) -> None:
    """Contours as a few dozen short strokes with small errors and overlaps, like those of a robot's marker.

    Wanted are pixels darker than their surroundings (Winnemöller, Kyprianidis and Olsen 2012). Each stroke starts at a
    wanted pixel that is not covered yet. Its direction and length are those that cover the most wanted pixels.
    """
    side = min(image.shape[:2])
    pen = generator.uniform(0.008, 0.023) * side  # of 64 px: 0.5 to 1.5
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    low, high = np.percentile(grey[::4, ::4], [2, 98])
    grey = np.clip((grey - low) / max(float(high - low), 1e-3), 0, 1)
    near, far = (cv2.GaussianBlur(grey, (0, 0), width * side) for width in (0.009, 0.036))
    want = np.clip((far - near) / generator.uniform(0.12, 0.3), 0, 1) ** 2
    left, ink = want.copy(), _ink(generator)
    for strokes in np.diff(np.linspace(0, generator.integers(40, 90), _ROUNDS + 1).astype(int)).tolist():
        ends = _best_strokes(want, left, strokes, generator)
        cv2.polylines(left, list(np.rint(ends).astype(np.int32)), False, (0.0,), max(1, round(1.3 * pen)))
        missed = ends + generator.normal(0, 0.004 * side, ends.shape)
        middles = missed.mean(1, keepdims=True) + generator.normal(0, 0.012 * side, (strokes, 1, 2))
        bent = np.concatenate([missed[:, :1], middles, missed[:, 1:]], 1)
        cv2.polylines(canvas, list(np.rint(8 * bent).astype(np.int32)), False, ink, max(1, round(pen)), cv2.LINE_AA, 3)


def _best_strokes(
    want: NDArray[np.floating], left: NDArray[np.floating], strokes: int, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Both ends [n, 2, 2] (x, y) of strokes around points drawn from `left`, along the contours in `want`."""
    height, width = want.shape
    summed = np.cumsum(left.ravel() + 2e-5, dtype=np.float64)
    places = np.searchsorted(summed, generator.random(strokes) * summed[-1]).clip(max=want.size - 1)
    angles = generator.uniform(0, np.pi) + np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS
    lengths = _LENGTHS * min(height, width) * generator.uniform(0.7, 1.2)
    steps = np.linspace(-0.5, 0.5, 9)[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)[:, None]
    middles = np.stack([places % width, places // width], 1)
    points = middles[:, None, None, None] + lengths[:, None, None, None] * steps  # [n, lengths, ways, 9, 2]
    columns, rows = np.rint(points).astype(int).transpose(4, 0, 1, 2, 3)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    covered = (want[rows.clip(0, height - 1), columns.clip(0, width - 1)] * inside).mean(-1)
    gain = np.where(covered < _MIN_CONTOUR, covered - 1, (covered - _MIN_CONTOUR) * lengths[:, None] ** 0.7)
    best = gain.reshape(strokes, -1).argmax(1)
    chosen = points.reshape(strokes, -1, 9, 2)[np.arange(strokes), best]
    return np.stack([chosen[:, 0], chosen[:, -1]], 1)


def _draw_colors(
    canvas: NDArray[np.uint8], image: NDArray[np.uint8], pen: float, *, generator: np.random.Generator
) -> None:
    """Strokes in the colours of the picture, broad ones first (Hertzmann 1998)."""
    for times, strokes in ((4, 160), (1.5, 500)):
        width = max(2, round(times * pen))
        rows, columns = (generator.integers(0, extent, strokes) for extent in image.shape[:2])
        angles = generator.uniform(0, np.pi) + generator.normal(0, 0.5, strokes)
        ends = _segments(columns, rows, angles, length=1.2 * width, generator=generator)
        colors = image[rows, columns]
        # A stroke is left out where it would put a colour that is there already.
        off = np.abs(canvas[rows, columns].astype(int) - colors).max(1) > 24
        for (start, end), color in zip(ends[off].tolist(), colors[off].tolist(), strict=True):
            cv2.line(canvas, start, end, color, width, cv2.LINE_AA)


def _segments(
    columns: NDArray[np.integer],
    rows: NDArray[np.integer],
    angles: NDArray[np.floating],
    *,
    length: float,
    generator: np.random.Generator,
) -> NDArray[np.int32]:
    """Both ends [n, 2, 2] (x, y) of segments around centres, with random variations of length and angle."""
    half = 0.5 * length * generator.uniform(0.6, 1.4, len(columns))
    turned = angles + generator.normal(0, 0.15, len(columns))
    steps = np.stack([half * np.cos(turned), half * np.sin(turned)], 1)
    middles = np.stack([columns, rows], 1)
    return np.rint(np.stack([middles - steps, middles + steps], 1)).astype(np.int32)
