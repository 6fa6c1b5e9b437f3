"""What a scene shows: which things, of which colours, how they stand to each other, before which ground.

Scenes are split by composition. A composition is a pair of kinds, or a kind with a colour; some of both are never in
the training set, so that what is asked for in a test was never seen together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from pentimento.contracts.scenes import SPLITS
from pentimento.copainting.scenes.things import KINDS

Arrangement = Literal["alone", "beside", "above", "row", "over_two"]

THINGS: Final[dict[Arrangement, int]] = {"alone": 1, "beside": 2, "above": 2, "row": 3, "over_two": 3}
"""How many things: beside from left to right, above from top to bottom, over_two the upper one first."""

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
"""For each ground the sRGB of its upper and lower part; pale, so that a drawing's lines are those of the things."""

_TEST_GAPS: Final = (3, 7)
_VAL_GAPS: Final = (5,)


@dataclass(frozen=True)
class Thing:
    """A kind of ``things.DRAWINGS`` in a colour of ``COLORS``."""

    kind: str
    color: str


@dataclass(frozen=True)
class Composition:
    """What a scene shows."""

    things: tuple[Thing, ...]
    """In the order that the arrangement says."""
    arrangement: Arrangement
    ground: str


class Splits:
    """Which compositions belong to which split; the same for the same seed.

    Kinds stand on a circle in a seeded order. Two kinds so many steps apart are a test pair, so many a validation
    pair, all others train: every kind is in as many held-out pairs as any other. So with colours: of each kind one is
    for the test and one for validation.
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
        """Test where anything in it is for the test only, otherwise val likewise, otherwise train."""
        things = composition.things
        found = {self.of_thing(thing) for thing in things}
        found |= {self.of_pair(a.kind, b.kind) for i, a in enumerate(things) for b in things[:i]}
        return next(split for split in ("test", "val", "train") if split in found)


def compose(split: str, splits: Splits, generator: np.random.Generator) -> Composition:
    """A composition drawn at random from those of a split.

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
