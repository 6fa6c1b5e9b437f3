"""A blind page on which people say which of two drawings fits a text better (thesis 6.5.3, Figure 6.6).

The page is one HTML file that needs no network; which drawing is whose stands in a key that is kept apart from it.
"""

from __future__ import annotations

import hashlib
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.images import encode_png
from pentimento.copainting.evaluation.preference_template import PAGE, QUESTIONS

Picture = NDArray[np.uint8]

_SHOWN_PX = 256


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two drawings for one text."""

    caption: str
    ours: Picture
    """Uint8 [H, W, 3]."""
    other: Picture
    rival: str
    """Whose the other is."""


def preference_page(comparisons: Sequence[Comparison], seed: int) -> tuple[str, dict[str, dict[str, str]]]:
    """The page, and its key {id: {left, right}} with `ours` on one side and the rival's name on the other.

    Order and sides are drawn by the seed; ids say nothing of either.
    """
    generator = np.random.default_rng([seed, 7])
    shown: list[dict[str, str]] = []
    key: dict[str, dict[str, str]] = {}
    for index in generator.permutation(len(comparisons)):
        one = comparisons[index]
        sides = [("ours", one.ours), (one.rival, one.other)]
        if generator.random() < 0.5:
            sides.reverse()
        name = hashlib.sha256(f"{seed} {index}".encode()).hexdigest()[:12]
        key[name] = {"left": sides[0][0], "right": sides[1][0]}
        shown.append({"id": name, "caption": one.caption, "left": _uri(sides[0][1]), "right": _uri(sides[1][1])})
    return PAGE.replace(QUESTIONS, _questions(shown)), key


def _questions(shown: Sequence[Mapping[str, str]]) -> str:
    """Each as a fieldset, readable without a script; the answers are radio buttons."""
    return "\n".join(
        f"""<fieldset data-id="{one["id"]}">
<legend>{number} of {len(shown)}: <q>{escape(one["caption"])}</q></legend>
<div class="pair"><img alt="the left drawing" src="{one["left"]}"><img alt="the right drawing" src="{one["right"]}">
</div>
{_choices(one["id"])}
</fieldset>"""
        for number, one in enumerate(shown, 1)
    )


def _choices(name: str) -> str:
    words = {"left": "the left fits better", "right": "the right fits better", "both": "both fit", "neither": "neither"}
    return "\n".join(
        f'<label><input type="radio" name="{name}" value="{value}"> {text}</label>' for value, text in words.items()
    )


def _uri(picture: Picture) -> str:
    large = cv2.resize(picture, (_SHOWN_PX, _SHOWN_PX), interpolation=cv2.INTER_NEAREST)
    return f"data:image/png;base64,{b64encode(encode_png(np.asarray(large, dtype=np.uint8))).decode('ascii')}"
