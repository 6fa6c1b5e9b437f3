"""What a person would say a scene shows, in wordings that vary."""

from __future__ import annotations

from typing import Final

import numpy as np

from pentimento.copainting.scenes.compositions import Arrangement, Composition, Thing
from pentimento.copainting.scenes.phrases import phrase

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


def wordings(composition: Composition, number: int, generator: np.random.Generator) -> list[str]:
    """That many captions; every second one, from the second on, names no colour and no ground.

    A drawing in one ink shows neither, and a person who asks for one does not name them.
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
