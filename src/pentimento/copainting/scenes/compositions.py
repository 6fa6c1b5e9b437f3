"""What a scene shows: kinds of things, their colours, arrangement and background; its captions and its split.

Scenes are split by composition: by the pair of kinds, and by the kind with its colour. Some of both occur in the test
split only, so that the test split asks for combinations that no training scene shows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from pentimento.contracts.scenes import SPLITS, phrase
from pentimento.copainting.scenes.things import KINDS

Arrangement = Literal["alone", "beside", "above", "row", "over_two"]

THINGS: Final[dict[Arrangement, int]] = {"alone": 1, "beside": 2, "above": 2, "row": 3, "over_two": 3}
"""Number of things. Their order: `beside` and `row` from left to right, `above` from top to bottom, `over_two` the
upper one first.
"""

COLORS: Final = {
    "red": (205, 45, 45),
    "orange": (240, 140, 40),
    "yellow": (245, 210, 50),
    "green": (55, 150, 65),
    "blue": (50, 85, 195),
    "purple": (130, 65, 170),
    "pink": (240, 130, 175),
    "brown": (125, 80, 45),
}

GROUNDS: Final = {
    "white paper": ((250, 250, 247), (250, 250, 247)),
    "grey paper": ((218, 218, 220), (218, 218, 220)),
    "sky": ((196, 223, 243), (208, 231, 246)),
    "meadow": ((222, 236, 240), (206, 230, 188)),
    "beach": ((224, 237, 244), (241, 230, 198)),
    "sea": ((232, 240, 246), (196, 220, 238)),
    "snow": ((224, 231, 238), (247, 249, 251)),
    "room": ((246, 236, 222), (230, 208, 184)),
    "dusk": ((250, 220, 196), (226, 202, 206)),
}
"""sRGB of the upper and the lower part of each background. They are pale, so that the contours of a drawing are those
of the things.
"""

_TEST_GAPS: Final = (3, 7)  # distances of two kinds on the circle of `Splits` whose pair is in the test split
_VAL_GAPS: Final = (5,)

_SENTENCES: Final[dict[Arrangement, tuple[str, ...]]] = {
    "alone": ("{a}", "{a}", "there is {a}", "just {a}"),
    "beside": (
        "{a} to the left of {b}", "{a} left of {b}", "{b} to the right of {a}", "{b} right of {a}", "{a} beside {b}",
        "{b} beside {a}", "{a} next to {b}", "{b} next to {a}", "{a} and {b} side by side",
    ),
    "above": (
        "{a} above {b}", "{a} over {b}", "{b} below {a}", "{b} under {a}", "{b} with {a} above it",
        "{a} with {b} below it",
    ),
    "row": (
        "{a}, {b} and {c} in a row", "{b} between {a} and {c}", "{b} with {a} on the left and {c} on the right",
        "{a} left of {b} and {c}",
    ),
    "over_two": (
        "{a} above {b} and {c}", "{b} and {c} below {a}", "{b} next to {c} with {a} above", "{a} over {b} and {c}",
    ),
}  # fmt: skip
_OPENINGS: Final = ("", "", "", "a picture of ", "a drawing of ", "a painting of ")
_PLACES: Final = {
    "white paper": ("on white paper", "on a white ground"),
    "grey paper": ("on grey paper", "on a grey ground"),
    "sky": ("in a blue sky", "in the sky"),
    "meadow": ("in a meadow", "on green grass"),
    "beach": ("on a beach", "on the sand"),
    "sea": ("by the sea", "on the water"),
    "snow": ("in the snow", "on a winter day"),
    "room": ("in a room", "indoors"),
    "dusk": ("at dusk", "in the evening"),
}


@dataclass(frozen=True)
class Thing:
    """A kind of `things.DRAWINGS` in a colour of `COLORS`."""

    kind: str
    color: str


@dataclass(frozen=True)
class Composition:
    """The content of a scene."""

    things: tuple[Thing, ...]
    """In the order of the arrangement, see `THINGS`."""
    arrangement: Arrangement
    ground: str


class Splits:
    """The split of each composition, as a function of a seed.

    Kinds stand on a circle in a seeded order. The distance of two kinds on the circle decides the split of the pair, so
    each kind is in as many held-out pairs as any other. Colours work the same way: of each kind, one colour is for the
    test split and one for validation.
    """

    def __init__(self, seed: int) -> None:
        generator = np.random.default_rng([seed, 0])
        self._place = {KINDS[kind]: place for place, kind in enumerate(generator.permutation(len(KINDS)))}
        self._shade = {name: int(shade) for name, shade in zip(COLORS, generator.permutation(len(COLORS)), strict=True)}

    def of_pair(self, one: str, other: str) -> str:
        """The split of two kinds."""
        apart = abs(self._place[one] - self._place[other])
        gap = min(apart, len(KINDS) - apart)
        return "test" if gap in _TEST_GAPS else "val" if gap in _VAL_GAPS else "train"

    def of_thing(self, thing: Thing) -> str:
        """The split of a kind in a colour."""
        step = (self._shade[thing.color] - self._place[thing.kind]) % len(COLORS)
        return "test" if step == 0 else "val" if step == 1 else "train"

    def of(self, composition: Composition) -> str:
        """`test` if any pair or coloured kind is in the test split, else `val` by the same rule, else `train`."""
        things = composition.things
        found = {self.of_thing(thing) for thing in things}
        found |= {self.of_pair(a.kind, b.kind) for i, a in enumerate(things) for b in things[:i]}
        return next(split for split in ("test", "val", "train") if split in found)


def compose(split: str, splits: Splits, generator: np.random.Generator) -> Composition:
    """A random composition of a split.

    Raises:
        ValueError: there is no such split.
    """
    if split not in SPLITS:
        raise ValueError(f"There is no split {split!r}; known are {', '.join(SPLITS)}.")
    while True:
        composition = _draw(generator)
        if splits.of(composition) == split:
            return composition


def _draw(generator: np.random.Generator) -> Composition:
    names: list[Arrangement] = ["alone", "beside", "above", "row", "over_two"]
    arrangement = names[generator.choice(5, p=[0.45, 0.27, 0.18, 0.03, 0.07])]
    kinds = generator.choice(len(KINDS), THINGS[arrangement], replace=False)
    colors = generator.choice(list(COLORS), len(kinds))
    things = tuple(Thing(KINDS[kind], str(color)) for kind, color in zip(kinds, colors, strict=True))
    return Composition(things, arrangement, str(generator.choice(list(GROUNDS))))


def wordings(composition: Composition, number: int, generator: np.random.Generator) -> list[str]:
    """`number` captions. Every second one names neither colours nor background, because a drawing in one ink shows
    neither.
    """
    return [_caption(composition, index % 2 == 0, generator) for index in range(number)]


def _caption(composition: Composition, colored: bool, generator: np.random.Generator) -> str:
    sentence = str(generator.choice(_SENTENCES[composition.arrangement]))
    things = {letter: _named(thing, colored) for letter, thing in zip("abc", composition.things, strict=False)}
    opening = "" if sentence.startswith(("there", "just")) else str(generator.choice(_OPENINGS))
    place = " " + str(generator.choice(_PLACES[composition.ground])) if colored and generator.random() < 0.5 else ""
    return opening + sentence.format(**things) + place


def _named(thing: Thing, colored: bool) -> str:
    return phrase(thing.kind, thing.color if colored else None)
