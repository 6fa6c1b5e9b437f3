""" "The house": things that stand on the canvas since an earlier turn, and the places of new things beside them.

A request's article tells them from new things: "a tree beside the house" draws a tree alone, where a house stands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.control.layout import INSIDE, Window, Wish, arranged, painted_share
from pentimento.control.request import Asked, Understood
from pentimento.control.turn import read_turns

Picture = NDArray[np.uint8]
Standing = Mapping[str, Window]
"""Windows by the words of a thing, such as "a house"."""

_ONE_SIDED: Final = ("to the left of", "to the right of")
_SCALES: Final = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
_OVER_PAINT: Final = 3.0
"""Cost of a place whose square is painted all over; that of a place which is half as large is .5."""
_SHIFTED: Final = 2.0
"""Cost of a place that is a side of the canvas away from where the relation has it."""


def standing_in(folder: Path, executed: int) -> Standing:
    """The things that were drawn in the turns of a painting; of several of a kind, those of the last turn.

    Args:
        executed: number of the robot's strokes so far: a thing of which no stroke was made does not stand there.
    """
    found: dict[str, Window] = {}
    turns = read_turns(folder)
    ends = [*(turn.executed_before for turn in turns[1:]), executed]
    for turn, end in zip(turns, ends, strict=True) if turns else ():
        if end > turn.executed_before:
            found |= {
                words: _around([thing.window for thing in turn.things if thing.words == words])
                for words in {thing.words for thing in turn.things}
            }
    return found


def known_things(request: Understood, standing: Standing) -> list[Asked]:
    """The things of a request that stand on the canvas already."""
    return [thing for thing in request.things if thing.is_definite and thing.words in standing]


def beside_standing(request: Understood, canvas: Picture, standing: Standing, *, largest: float) -> list[Wish]:
    """Where the new things of a request are drawn on a square canvas, as it relates them to the first known one.

    Args:
        canvas: uint8 [S, S, 3].
        largest: the greatest side of the new things' arrangement, in sides of the canvas.

    Raises:
        ConfigError: the request names nothing new.
    """
    known = known_things(request, standing)
    new = [thing for thing in request.things if thing not in known]
    anchor = known[0]
    if not new:
        name = _name(anchor.words)
        raise ConfigError(
            f'The {name} is on the canvas already; say what to add, such as "a tree beside the {name}". '
            "Nothing was painted."
        )
    inside = arranged(new, in_a_row=request.in_a_row)
    pair = _pair(request.things, new, anchor)
    parts = [wish.window for wish in inside]
    frame = _best_place(pair, standing[anchor.words], parts, canvas, largest=largest)
    return [Wish(wish.words, wish.window.within(frame)) for wish in inside]


def sentences(request: Understood, standing: Standing) -> list[str]:
    """What the person must know, such as "the house: the one on the canvas"."""
    known = known_things(request, standing)
    new = [thing for thing in request.things if thing.is_definite and thing not in known]
    return [
        *(f"the {_name(thing.words)}: the one on the canvas" for thing in known),
        *(f"the {_name(thing.words)}: none that the robot drew is on the canvas, so one is drawn" for thing in new),
    ]


def _pair(things: Sequence[Asked], new: Sequence[Asked], anchor: Asked) -> tuple[Asked, Asked]:
    """The new things as one, with empty words, and the known one, in the order in which they were said."""
    if things.index(new[0]) < things.index(anchor):
        return Asked("", 1, None), Asked(anchor.words, 1, anchor.link)
    return Asked(anchor.words, 1, None), Asked("", 1, new[0].link)


def _best_place(
    pair: tuple[Asked, Asked], anchor: Window, parts: Sequence[Window], canvas: Picture, *, largest: float
) -> Window:
    """The frame of the new things, whose windows in it are ``parts``: where the paint is least, as large and as near to
    their relation's place as can be.

    A relation that says no side, such as "beside", leaves the choice between left and right.
    """
    windows = {wish.words: wish.window for wish in arranged(pair, in_a_row=False)}
    new, other = windows[""], windows[next(thing.words for thing in pair if thing.words)]
    sides = (1.0,) if pair[1].link in _ONE_SIDED else (1.0, -1.0)
    # Each of several things is as large as one would be, but for those inside the known one.
    times = 1 if pair[1].link in INSIDE else 1 / max(part.size for part in parts)
    share = painted_share(canvas)
    best: tuple[float, Window] | None = None
    for scale in _SCALES:
        size = scale * min(largest, times * anchor.size * new.size / other.size)
        reach = (size + anchor.size) / (new.size + other.size)
        for side in sides:
            wanted = Window(anchor.x + side * reach * (new.x - other.x), anchor.y + reach * (new.y - other.y), size)
            (left, top), (right, bottom) = _box([part.within(wanted) for part in parts])
            down = anchor.y + anchor.size / 2 - bottom if new.y == other.y else 0.0  # on the same ground
            aside = max(0.0, -left) - max(0.0, right - 1)
            down += max(0.0, -top - down) - max(0.0, bottom + down - 1)
            frame = Window(wanted.x + aside, wanted.y + down, size)
            covered = float(np.mean([share(part.within(frame)) for part in parts]))
            cost = _OVER_PAINT * covered + _SHIFTED * abs(aside) + (1 - scale)
            if best is None or cost < best[0]:
                best = cost, frame
    assert best is not None
    return best[1]


def _around(windows: Sequence[Window]) -> Window:
    """The smallest square around windows, about their middle."""
    low, high = _box(windows)
    return Window((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, max(high[0] - low[0], high[1] - low[1]))


def _box(windows: Sequence[Window]) -> tuple[tuple[float, float], tuple[float, float]]:
    """The left upper and the right lower corner of windows."""
    x, y, half = np.array([[window.x, window.y, window.size / 2] for window in windows]).T
    return (float((x - half).min()), float((y - half).min())), (float((x + half).max()), float((y + half).max()))


def _name(words: str) -> str:
    """ "house" of "a house"; "scissors" of "scissors"."""
    return words.removeprefix("an ").removeprefix("a ")
