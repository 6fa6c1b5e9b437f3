"""Blind pages: each rater's own order, sides and ids, drawn by the seed; what they hide is in a separate key."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import encode_png
from pentimento.rating.study import Study
from pentimento.report.templates import render

Picture = NDArray[np.uint8]

_MAX_SIDE_PX: Final = 512


@dataclass(frozen=True, eq=False)
class Trial:
    """One part of a page."""

    item: str
    pictures: dict[str, Picture]
    """By condition, uint8 sRGB [H, W, 3]."""
    reference: Picture | str | None = None
    """The picture or text beside them."""
    right: str | None = None
    """The condition that the reference belongs to; form match."""


@dataclass(frozen=True)
class Hidden:
    """What a page does not tell of one of its trials."""

    item: str
    shown: tuple[str, ...]
    """Conditions, from left to right."""
    right: str | None


@dataclass(frozen=True)
class Key:
    """What belongs to the pages of a study, and stays with the person who evaluates it."""

    study: Study
    conditions: tuple[str, ...]
    """The first is the one that the others are compared with."""
    pages: dict[str, dict[str, Hidden]]
    """By the page's id and the trial's."""


def trials_of(study: Study, items: Mapping[str, Mapping[str, Picture]], references: Mapping[str, Picture | str]) -> (
    list[Trial]
):  # fmt: skip
    """Every trial of a study.

    Args:
        items: by item and condition; every item has the same conditions, in the order that results follow.
        references: by item, or by condition where the form is match; empty where the study shows none.

    Raises:
        ConfigError: a condition is called like a tie.
    """
    if called := {name for by_condition in items.values() for name in by_condition} & {*study.ties}:
        raise ConfigError(f"A condition is called {called.pop()!r}, which is an answer of this study; rename it.")
    trials = []
    for item, by_condition in items.items():
        pictures = dict(by_condition)
        first, *others = pictures
        if study.form == "panel":
            trials += [Trial(item, {name: picture}, references.get(item)) for name, picture in pictures.items()]
        elif study.form == "match":
            trials += [Trial(item, pictures, references[name], name) for name in pictures]
        else:
            trials += [
                Trial(item, {first: pictures[first], other: pictures[other]}, references.get(item)) for other in others
            ]
    return trials


def pages(
    study: Study, trials: Sequence[Trial], *, raters: int, per_rater: int | None, seed: int
) -> tuple[dict[str, str], Key]:
    """A page for each rater, by its id, and the key of all.

    Args:
        per_rater: maximum number of trials on a page; None for all. All trials come equally often, but for one.
    """
    dealt = np.random.default_rng([seed, 0]).permutation(len(trials))
    many = min(per_rater or len(trials), len(trials))
    texts: dict[str, str] = {}
    hidden: dict[str, dict[str, Hidden]] = {}
    for rater in range(raters):
        mine = [trials[dealt[(rater * many + place) % len(trials)]] for place in range(many)]
        name = _id(seed, rater)
        texts[name], hidden[name] = _page(study, mine, name, np.random.default_rng([seed, 1, rater]))
    conditions = tuple(dict.fromkeys(name for trial in trials for name in trial.pictures))
    return texts, Key(study, conditions, hidden)


def _page(
    study: Study, trials: Sequence[Trial], page: str, generator: np.random.Generator
) -> tuple[str, dict[str, Hidden]]:
    parts: list[dict[str, object]] = []
    hidden: dict[str, Hidden] = {}
    for number, index in enumerate(generator.permutation(len(trials))):
        trial = trials[index]
        shown = tuple(np.array(list(trial.pictures))[generator.permutation(len(trial.pictures))].tolist())
        name = _id(page, number)
        hidden[name] = Hidden(trial.item, shown, trial.right)
        parts.append(
            {
                "id": name,
                "text": trial.reference if isinstance(trial.reference, str) else None,
                "reference": None if isinstance(trial.reference, str | None) else _png(trial.reference),
                "pictures": [_png(trial.pictures[condition]) for condition in shown],
            }
        )
    choices = study.choices(len(trials[0].pictures))
    return render("rating.html", study=study, page=page, parts=parts, choices=choices), hidden


def _id(*of: object) -> str:
    """A name that tells nothing."""
    return hashlib.sha256(" ".join(map(str, of)).encode()).hexdigest()[:12]


def _png(picture: Picture) -> bytes:
    """The pixels alone, without what their file said, at most 512 on a side."""
    height, width = picture.shape[:2]
    share = _MAX_SIDE_PX / max(height, width)
    if share < 1:
        size = max(1, round(width * share)), max(1, round(height * share))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return encode_png(picture)
