"""`pentimento import` of a CSV file with one picture of the page that shows all its strokes.

Each row keeps the window around its path. What a photograph before and after the stroke would have shown is composed
from the page: a pixel near paths belongs to the stroke of the nearest one, and strokes appear in their order. Where
strokes cross, this is a guess: the nearest path has the pixel, whichever stroke was on top.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import check_replaceable
from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.frames import canvas_to_pixel, crop, pixels_per_m, snap_window, window_around
from pentimento.contracts.images import read_image
from pentimento.io.marker_views import read_markers, rectified
from pentimento.io.photo_pairs import import_strokes, read_paths
from pentimento.io.stroke_rows import (
    COMMAND,
    MARGIN_M,
    Imported,
    Placement,
    RecordedPath,
    Refused,
    placed_path,
    row_of,
)

Picture = NDArray[np.uint8]
FloatArray = NDArray[np.float64]

_NOBODY: Final = -1
_EDGE: Final = 0.05
"""Share of the contrast on the paths at which ink ends."""
_MIN_CONTRAST: Final = 0.02
"""Contrast between the paths and the paper around them, of the range of 8 bits, below which there is no ink."""
_REACHES: Final = 2.0
"""Margin of a row, in reaches: farther off, no pixel belongs to its stroke."""


class Page(NamedTuple):
    """A page, and which stroke each of its pixels belongs to."""

    picture: Picture
    """[H, W, 3], sRGB."""
    blank: Picture | None
    """The same page without strokes; None: the paper is filled with its colour near each path."""
    window_m: FloatArray
    """[4], canvas frame."""
    owner: NDArray[np.int32]
    """[H, W] place of the stroke in the order of execution; -1 where no path is within reach."""
    reach_m: float
    """Distance from the paths within which there is ink."""

    def before_and_after(self, place: int, window_m: FloatArray) -> tuple[Picture, Picture]:
        """The pictures [h, w, 3] in a window before and after the stroke at this place of the order.

        Raises:
            Refused: no pixel belongs to the stroke, or there is no paper to show before it.
        """
        shown, owner = (crop(each, self.window_m, window_m) for each in (self.picture, self.owner))
        if not (owner == place).any():
            raise Refused("other paths are as near as its own to all of its ink")
        if self.blank is not None:
            paper = crop(self.blank, self.window_m, window_m)
        else:
            bare = shown[owner == _NOBODY]
            if len(bare) == 0:
                raise Refused("no paper is bare around it, and there is no picture of the blank page")
            paper = np.where((owner == _NOBODY)[..., None], shown, np.median(bare, axis=0).astype(np.uint8))
        drawn = owner != _NOBODY
        before, after = ((drawn & (owner < end))[..., None] for end in (place, place + 1))
        return np.where(before, shown, paper), np.where(after, shown, paper)


def import_page(
    paths: Path,
    page: Path,
    blank: Path | None,
    placement: Placement,
    tool: str,
    out: Path,
    *,
    markers: Path | None = None,
    strokes: list[RecordedPath] | None = None,
) -> Imported:
    """Write the folder ``out`` as ``import_photo_pairs`` does, from one picture of the page after all strokes.

    Args:
        page: rectified to ``placement``, or with ``markers`` in view.
        blank: the same page before the first stroke, in the same place, or with the same markers.
        markers: CSV of the markers by which both pictures are rectified to the edges of ``placement``.
        strokes: of the file ``paths``; None: it is a CSV.

    Raises:
        ContractError: a file cannot be read, the page shows no ink along the paths, or no stroke can be used.
        ConfigError: ``out`` holds what this command did not write.
    """
    check_replaceable(out, COMMAND)
    strokes = read_paths(paths) if strokes is None else strokes
    picture, bare = _read(page), None if blank is None else _read(blank)
    if markers is not None:
        picture, *rest = _rectified([picture] if bare is None else [picture, bare], markers, placement, page)
        bare = rest[0] if rest else None
    if bare is not None and bare.shape != picture.shape:
        raise ContractError(f"{blank} and {page} differ in size; scan both in the same way.")
    shape = picture.shape[0], picture.shape[1]
    placed: dict[int, FloatArray] = {}
    for number, stroke in enumerate(strokes):
        if stroke.fault is not None:
            continue  # import_strokes refuses and counts it
        try:
            placed[number] = placed_path(stroke, placement, shape)
        except Refused:
            continue  # likewise
    order = sorted(placed, key=lambda number: strokes[number].about.get("order", number))
    whole = np.array(placement.window_m(shape))
    owned = divided(picture, bare, whole, [placed[number] for number in order]) if order else None
    places = {number: place for place, number in enumerate(order)}

    def row(number: int, stroke: RecordedPath, given: Mapping[str, Any]) -> dict[str, Any]:
        path = placed_path(stroke, placement, shape)
        assert owned is not None  # at least this path is placed
        margin = min(_REACHES * owned.reach_m, MARGIN_M)
        window = snap_window(window_around(path, margin), owned.window_m, shape)
        before, after = owned.before_and_after(places[number], window)
        return row_of(stroke, path, window, before=before, after=after, given=given)

    return import_strokes(paths, strokes, row, tool, out)


def divided(picture: Picture, blank: Picture | None, window_m: FloatArray, paths: list[FloatArray]) -> Page:
    """Divide a page among paths [N, 5] (canvas frame), which are in the order of execution.

    Raises:
        ContractError: the page is not darker or lighter along the paths than beside them.
    """
    distance = np.full(picture.shape[:2], np.inf, np.float32)
    owner = np.full(picture.shape[:2], _NOBODY, np.int32)
    scale = pixels_per_m(picture.shape, window_m)
    for place, path in enumerate(paths):
        around = snap_window(window_around(path, MARGIN_M), window_m, picture.shape)
        part = crop(distance, window_m, around)
        to_path = _distance_px(canvas_to_pixel(path[:, 1:3], around, scale), part.shape)
        nearer = to_path < part
        part[nearer] = to_path[nearer]  # views: the page's own arrays change
        crop(owner, window_m, around)[nearer] = place
    reach_px = _reach_px(picture, blank, distance, MARGIN_M * scale)
    owner[distance > reach_px] = _NOBODY
    return Page(picture, blank, window_m, owner, reach_px / scale)


def _distance_px(path_px: FloatArray, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Distance [H, W] of each pixel from a path [N, 2] (column, row)."""
    line = np.ones(shape, np.uint8)
    cv2.polylines(line, [np.round(path_px).astype(np.int32)], False, 0)
    return np.asarray(cv2.distanceTransform(line, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), np.float32)


def _reach_px(picture: Picture, blank: Picture | None, distance: NDArray[np.float32], farthest_px: float) -> float:
    """Distance from the paths at which the mean contrast with the paper has fallen to that of the paper."""
    near = distance < farthest_px
    far = picture[~near] if (~near).any() else picture.reshape(-1, 3)
    paper = (np.median(far, axis=0) if blank is None else blank[near]).astype(np.float32)
    contrast = np.abs(picture[near] - paper).mean(-1) / 255
    bins = distance[near].astype(int)
    count = np.bincount(bins)
    profile = np.bincount(bins, contrast)[count > 0] / count[count > 0]
    level = float(np.median(profile[len(profile) // 2 :])) if len(profile) else 0.0
    ink = float(profile[0]) - level if len(profile) else 0.0
    ends = np.flatnonzero(profile - level < _EDGE * ink)
    if ink < _MIN_CONTRAST or len(ends) == 0:
        raise ContractError(
            "The page shows no ink along the paths that the paper beside them lacks: check --window or --scale and "
            "--y-down, that the page is rectified, and that it is the page of these paths."
        )
    return float(np.flatnonzero(count)[ends[0]] + 1)


def _rectified(pictures: list[Picture], markers: Path, placement: Placement, page: Path) -> list[Picture]:
    window_m = np.array(placement.window_m((0, 0)))
    try:
        return rectified(pictures, read_markers(markers, placement), window_m, one_camera=False)
    except Refused as error:
        raise ContractError(f"{page} or its blank page is not usable: {error}.") from error


def _read(path: Path) -> Picture:
    try:
        return read_image(path)
    except PentimentoError as error:
        raise ContractError(f"{path} is not a readable picture ({error}); give the scan of the page.") from error
