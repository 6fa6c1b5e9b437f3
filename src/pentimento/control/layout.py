"""Where on a canvas the things of a request are drawn: each thing fills a square window of its own.

A goal planner that was taught one thing at a time draws each with all its resolution, whatever stands beside it.
Relations of things are places of windows; what is on the canvas already leaves room for the whole arrangement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.requests import with_medium
from pentimento.control.painter import as_linear, as_picture
from pentimento.control.request import Asked, Understood

Picture = NDArray[np.uint8]

THING: Final = 0.875
"""Side of the square that a thing fills, in sides of its window: as the goal planner was taught it."""

_LINE: Final = 0.016
"""Width of a pen's lines in sides of the whole canvas, nearly as the goal planner was taught it."""
_WHITE: Final = 250.0  # sRGB of paper in the goal planner's training
_PAPER_FROM: Final = 225  # sRGB: a completion is paper where all channels are lighter
_DARKEST_PAPER: Final = 180  # sRGB of a channel
_ABOVE: Final = ("above", "over", "on", "on top of")
_BELOW: Final = ("below", "under")
_BEHIND: Final = ("behind",)
_BEFORE: Final = ("in front of", "before")
INSIDE: Final = ("inside", "in")
_SMALLEST: Final = 0.45  # side of a window that is looked for, in sides of the canvas: a brush draws nothing smaller
_CROWDED: Final = 0.6  # side of the whole arrangement where there is no room for it
_SIZE_STEP: Final = 0.05
_GRID: Final = 64  # resolution at which room is looked for, in cells along a side of the canvas
_INK_LEVELS: Final = 40  # difference from the paper, of 255 in any channel, from which on a pixel is painted
_BLANK_SHARE: Final = 0.001  # of the cells: with fewer painted ones the canvas counts as blank
_FREE_SHARE: Final = 0.01  # of the cells of the things' squares: with fewer painted ones the squares count as free


@dataclass(frozen=True)
class Window:
    """A square of a square canvas."""

    x: float
    """Of its centre, in sides of the canvas, to the right."""
    y: float
    """Down."""
    size: float
    """Its side, in sides of the canvas."""

    def within(self, other: Window) -> Window:
        """This window of another window, as a window of the canvas."""
        left, top = other.x - other.size / 2, other.y - other.size / 2
        return Window(left + self.x * other.size, top + self.y * other.size, self.size * other.size)

    def pixels(self, side_px: int) -> tuple[slice, slice]:
        """Rows and columns of this window in a canvas of `side_px` pixels a side; always a square within it."""
        side = min(side_px, max(1, round(self.size * side_px)))
        top, left = (
            int(np.clip(round((middle - self.size / 2) * side_px), 0, side_px - side)) for middle in (self.y, self.x)
        )
        return slice(top, top + side), slice(left, left + side)


@dataclass(frozen=True)
class Wish:
    """What is to be drawn in a window."""

    words: str
    """For the goal planner: "a cat"."""
    window: Window


WHOLE: Final = Window(0.5, 0.5, 1.0)


def wishes_for(
    request: Understood, canvas: Picture, medium: str, *, by_window: bool, largest: float = 1.0
) -> list[Wish]:
    """What is to be drawn where on a square canvas, uint8 [S, S, 3], in the order in which it is drawn.

    Args:
        medium: words of the medium, which every wish ends with.
        by_window: the goal planner was taught one thing at a time. If not, it gets the whole request at once.
        largest: the greatest side of the whole arrangement, in sides of the canvas.
    """
    found = [Wish(request.text, WHOLE)]
    if by_window and request.things:
        found = placed(request, canvas, largest=largest)
    return in_medium(found, medium)


def placed(request: Understood, canvas: Picture, *, largest: float = 1.0) -> list[Wish]:
    """The things of a request where a square canvas, uint8 [S, S, 3], has room for them; see `with_room`."""
    return with_room(arranged(request.things, in_a_row=request.in_a_row), canvas, largest=largest)


def in_medium(wishes: Sequence[Wish], medium: str) -> list[Wish]:
    """Wishes whose words end with those of the medium, as for the goal planner."""
    return [Wish(with_medium(wish.words, medium), wish.window) for wish in wishes]


def arranged(things: Sequence[Asked], *, in_a_row: bool) -> list[Wish]:
    """The things of a request on a blank square canvas, in the order in which they are drawn: what is behind first."""
    if len(things) == 2 and (special := _special(*things)):
        return special
    rows = _rows(things)
    if len(rows) == 1 and len(rows[0]) > 2 and not in_a_row:
        upper = len(rows[0]) // 2
        rows = [rows[0][:upper], rows[0][upper:]]
    return [
        Wish(words, Window((column + 0.5) / len(row), (number + 0.5) / len(rows), 1 / max(len(row), len(rows))))
        for number, row in enumerate(rows)
        for column, words in enumerate(row)
    ]


def _special(first: Asked, second: Asked) -> list[Wish] | None:
    """Two things of which one stands on, before or inside the other."""
    link = second.link
    if link in INSIDE and second.number == 1:
        size = min(0.45, 0.8 / first.number)
        columns = [0.5 + (number - (first.number - 1) / 2) * size for number in range(first.number)]
        return [Wish(second.words, WHOLE), *(Wish(first.words, Window(x, 0.52, size)) for x in columns)]
    if (first.number, second.number) != (1, 1):
        return None
    if link in ("on", "on top of"):
        return [Wish(second.words, Window(0.5, 0.69, 0.62)), Wish(first.words, Window(0.5, 0.24, 0.46))]
    if link in _BEHIND:
        return [Wish(first.words, Window(0.65, 0.34, 0.64)), Wish(second.words, Window(0.33, 0.66, 0.64))]
    if link in _BEFORE:
        return [Wish(second.words, Window(0.65, 0.34, 0.64)), Wish(first.words, Window(0.33, 0.66, 0.64))]
    return None


def _rows(things: Sequence[Asked]) -> list[list[str]]:
    """The words of each single thing, in rows from the top, each from left to right."""
    levels: dict[int, list[str]] = {0: []}
    level = 0
    for thing in things:
        units = [thing.words] * thing.number
        if thing.link in _ABOVE:
            level += 1
        elif thing.link in _BELOW:
            level -= 1
        row = levels.setdefault(level, [])
        at = 0 if thing.link in ("to the right of", "between") else len(row)
        row[at:at] = units
    return [levels[level] for level in sorted(levels)]


def with_room(wishes: Sequence[Wish], canvas: Picture, *, largest: float = 1.0) -> list[Wish]:
    """An arrangement where the square canvas, uint8 [S, S, 3], leaves most room for it.

    The whole arrangement is at most `largest` sides of the canvas wide. It is as large as it can be without lying over
    paint; where there is no room, it lies where the paint is least. It is near the middle, or, where `largest` is less
    than the canvas, near a corner: that leaves room for more.
    """
    painted = _painted(canvas)
    if painted.mean() <= _BLANK_SHARE:
        frame = Window(largest / 2, largest / 2, largest)
        return [Wish(each.words, each.window.within(frame)) for each in wishes]
    windows = [each.window for each in wishes]
    smallest = min(largest, _SMALLEST / min(window.size for window in windows))
    sums = _sums(painted)
    best: tuple[float, Window] | None = None
    for size in np.arange(largest, smallest - 1e-9, -_SIZE_STEP):
        share, frame = _freest(sums, windows, float(size), in_middle=largest == 1)
        if share <= _FREE_SHARE:
            best = share, frame
            break
    if best is None:
        best = _freest(sums, windows, min(largest, max(smallest, _CROWDED)), in_middle=largest == 1)
    return [Wish(each.words, each.window.within(best[1])) for each in wishes]


def painted_share(canvas: Picture) -> Callable[[Window], float]:
    """A function from a window to the share of painted cells in the square that a thing fills of it."""
    sums = _sums(_painted(canvas))
    return lambda window: _share(sums, window)


def _sums(painted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of cells above and to the left of each corner, [G + 1, G + 1]."""
    return np.pad(painted.cumsum(0).cumsum(1), ((1, 0), (1, 0)))


def _painted(canvas: Picture) -> NDArray[np.float64]:
    """Whether each cell shows paint, [G, G]."""
    marked = (np.abs(canvas - _paper(canvas)).max(-1) > _INK_LEVELS).astype(np.float32)
    return np.asarray(cv2.resize(marked, (_GRID, _GRID), interpolation=cv2.INTER_AREA) > 0.1, np.float64)


def _freest(
    sums: NDArray[np.float64], windows: Sequence[Window], size: float, *, in_middle: bool
) -> tuple[float, Window]:
    """The share of painted cells in the things' squares, and the frame of a size where it is least; the one nearest to
    the centre, or farthest from it, among equals.
    """
    places = np.arange(size / 2, 1 - size / 2 + 1e-9, 1 / 32)
    best: tuple[float, float, Window] | None = None
    for y in places:
        for x in places:
            frame = Window(float(x), float(y), size)
            share = float(np.mean([_share(sums, window.within(frame)) for window in windows]))
            off_centre = abs(x - 0.5) + abs(y - 0.5)
            key = (max(share, _FREE_SHARE), off_centre if in_middle else -off_centre)
            if best is None or key < best[:2]:
                best = (*key, frame)
    assert best is not None
    return best[0], best[2]


def _share(sums: NDArray[np.float64], window: Window) -> float:
    """The share of painted cells in the square that a thing fills of its window."""
    half = THING * window.size / 2
    left, right, top, bottom = (
        round(float(np.clip(value, 0, 1)) * _GRID)
        for value in (window.x - half, window.x + half, window.y - half, window.y + half)
    )
    count = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return float(count / max(1, (bottom - top) * (right - left)))


def drawn_in_windows(
    canvas: Picture,
    wishes: Sequence[Wish],
    *,
    side_px: int,
    has_ink: bool,
    complete: Callable[[Picture, str, int], Picture],
) -> Picture:
    """The goal: a square canvas, uint8 [S, S, 3], with each thing drawn in its window, one after the other.

    The goal planner sees the colours as on white paper, on which it was taught.

    Args:
        has_ink: the tool draws with its own ink, in lines of one width: those of small windows are widened to it.
        complete: a window's picture [side_px, side_px, 3], the words and the thing's number, from 0, to the same
            picture with the thing. What it leaves as it is stays as it is on the canvas.
    """
    goal = canvas.copy()
    whiten = _WHITE / _paper(canvas)
    for number, each in enumerate(wishes):
        there = each.window.pixels(canvas.shape[0])
        inner = np.ascontiguousarray(goal[there])
        side = inner.shape[0]
        small = _scaled(resized(inner, side_px), whiten)
        completion = complete(small, each.words, number)
        completion = _without_erasing(completion, small)
        if has_ink:
            completion = _with_wide_lines(completion, small, each.window.size)
        changed = (completion != small).any(-1).astype(np.uint8)
        changed = cv2.resize(changed, (side, side), interpolation=cv2.INTER_NEAREST)[..., None] > 0
        # Not resized where nothing changes, which would blur it.
        goal[there] = np.where(changed, resized(_scaled(completion, 1 / whiten), side), inner)
    return goal


def _paper(canvas: Picture) -> NDArray[np.float64]:
    """The colour of the canvas's lightest fifth, sRGB; white if that is no light paper."""
    light = canvas.mean(axis=2)
    colour = np.median(canvas[light >= np.percentile(light, 80)], axis=0)
    return np.asarray(colour if colour.min() > _DARKEST_PAPER else np.full(3, _WHITE))


def _scaled(picture: Picture, factor: NDArray[np.float64]) -> Picture:
    return np.clip(np.round(picture * factor), 0, 255).astype(np.uint8)


def _without_erasing(completion: Picture, before: Picture) -> Picture:
    """A completion that leaves paint where it would put paper: nobody asks for less than there is."""
    painted = np.abs(before - _WHITE).max(-1) > _INK_LEVELS
    erased = painted & (completion.min(-1) >= _PAPER_FROM)
    return np.where(erased[..., None], before, completion)


def _with_wide_lines(completion: Picture, before: Picture, size: float) -> Picture:
    """A completion of a window with what it adds in lines that are as wide on the canvas as those of a whole canvas."""
    grow = round(_LINE * completion.shape[0] * (1 / size - 1))
    if grow < 1:
        return completion
    added = np.where((completion != before).any(-1, keepdims=True), completion, np.uint8(255))
    pen = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (grow + 1, grow + 1))
    return np.minimum(completion, cv2.erode(added, pen))


def resized(picture: Picture, side_px: int) -> Picture:
    """A square picture at another size, in linear light: averaged down or interpolated up."""
    if picture.shape[0] == side_px:
        return picture
    method = cv2.INTER_AREA if side_px < picture.shape[0] else cv2.INTER_LINEAR
    return as_picture(np.asarray(cv2.resize(as_linear(picture), (side_px, side_px), interpolation=method), np.float32))
