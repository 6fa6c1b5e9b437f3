"""Test cases of goal planners: held-out prompts on canvases that show drawings of other prompts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ContractError
from pentimento.contracts.scenes import labels_of, phrase, read_scene, without_colors
from pentimento.control.layout import THING, Window, arranged
from pentimento.control.request import understand
from pentimento.copainting.drawings.scenes import (
    WHITE,
    DrawnScene,
    Placed,
    caption,
    draw_scene,
    render_scene,
    split_of_scene,
)
from pentimento.copainting.drawings.scenes import Medium as DrawingMedium
from pentimento.copainting.drawings.sources import nouns_of
from pentimento.copainting.scenes.collage import Half, pairs_in_training, put, random_halves, without

Picture = NDArray[np.uint8]

_BEGUN_SIZES: Final = (0.35, 0.6)  # of what somebody else began, in sides of the sheet
_FILLING_SIZES: Final = (0.75, 0.95)  # of the same where it leaves no room beside it
_BEGUN_TURN_RAD: Final = np.radians(8)  # standard deviation of its rotation
_BEGUN_LINES: Final = (0.015, 0.03)  # range of its lines' width, in sides of the sheet
_FILL_SRGB: Final = (70, 255)  # range of each channel of the colour that fills it
_SMALLEST: Final = 0.35  # size of a requested thing, in sides of the sheet
_TRIES: Final = 50  # scenes drawn to find one that no training scene combines with a given scene


@dataclass(frozen=True, eq=False)
class Case:
    """One prompt on one started canvas."""

    scene_id: str
    caption: str
    objects: tuple[str, ...]
    """Kinds that the prompt asks for; empty if the table does not name them."""
    image: Picture
    """The requested scene, uint8 [H, W, 3], placed where the canvas is free."""
    other_image: Picture
    """The scene whose drawing starts the canvas."""
    other_objects: tuple[str, ...]
    windows: tuple[Window, ...] = ()
    """Where on the canvas each of `objects` is requested, where that is known."""


def choose_cases(held_out: pa.Table, training: pa.Table, count: int, seed: int) -> list[Case]:
    """Up to `count` prompts of `held_out` scenes, on canvases that a drawing of another prompt starts (thesis 6.6.1).

    Both are checked `scenes` tables. Scenes with the fewest things, mostly one, come first, in the table's order; the
    other prompts are drawn from those with as few. A person who draws together with a robot leaves room for it: the
    other drawing is in one half of the sheet, the requested scene in the other half. Of 50 random candidates, the first
    is taken whose kinds no scene of `training` combines with those asked for. Case i depends on the tables and (seed,
    i) only.

    Raises:
        ContractError: fewer than two scenes, or pictures that are not squares of one size.
    """
    rows = sorted(
        (_read(row, number) for number, row in enumerate(held_out.to_pylist())),
        key=lambda row: (row.things == 0, row.things),
    )
    _check(rows)
    seen = pairs_in_training(training)
    fewest = [row for row in rows if row.things == rows[0].things]
    others = fewest if len(fewest) > 1 else rows
    cases = []
    for index, row in enumerate(rows[:count]):
        generator = np.random.default_rng([seed, index])
        other = _other(row, others, seen, generator)
        other_half, half = random_halves(generator)
        cases.append(
            Case(
                row.scene_id, row.caption, row.objects, _in_half(row, half, generator),
                _in_half(other, other_half, generator), other.objects,
            )
        )  # fmt: skip
    return cases


def begun_by_others(count: int, medium: DrawingMedium, *, side_px: int, overlapping: bool, seed: int) -> list[Case]:
    """`count` wishes for a named thing on canvases where somebody else began: a drawing of another thing, by another
    illustrator (Tabler), anywhere on the sheet, slightly turned, in thin or thick lines; in colour, filled with one.

    The two things are a held-out pair of nouns (`split_of_scene`). The other one leaves room beside it, or fills the
    sheet if `overlapping`. The requested one's picture is OpenMoji's drawing in such a place. Case i depends on
    (medium, seed, i) only.
    """
    generators = (np.random.default_rng([seed, index]) for index in range(count))
    return [
        _begun_by_others(index, medium, side_px, overlapping, generator) for index, generator in enumerate(generators)
    ]


def _begun_by_others(
    number: int, medium: DrawingMedium, side_px: int, overlapping: bool, generator: np.random.Generator
) -> Case:
    asked_nouns, other_nouns = nouns_of("openmoji"), nouns_of("tabler")
    while True:
        asked = asked_nouns[int(generator.integers(len(asked_nouns)))]
        other = other_nouns[int(generator.integers(len(other_nouns)))]
        if asked != other and split_of_scene("beside", (asked, other)) == "test":
            break
    size = float(generator.uniform(*(_FILLING_SIZES if overlapping else _BEGUN_SIZES)))
    x, y = (float(value) for value in generator.uniform(size / 2, 1 - size / 2, 2))
    turn, mirrored = float(generator.normal(0, _BEGUN_TURN_RAD)), bool(generator.random() < 0.5)
    there = Placed(other, "tabler", x, y, size, turn, mirrored)
    # Around the other thing: in the middle of the largest of the four strips that it leaves.
    room = {"left": x - size / 2, "right": 1 - x - size / 2, "upper": y - size / 2, "lower": 1 - y - size / 2}
    free = max(room, key=lambda name: room[name])
    extent = max(room[free], _SMALLEST)
    near, far = extent / 2, 1 - extent / 2
    place = {"left": (near, y), "right": (far, y), "upper": (x, near), "lower": (x, far)}[free]
    if overlapping:
        place, extent = (x, y), max(size, _SMALLEST)
    column, row = (float(np.clip(value, extent / 2, 1 - extent / 2)) for value in place)
    wished = Placed(asked, "openmoji", column, row, extent, 0.0, False)
    line = float(generator.uniform(*_BEGUN_LINES))
    scenes = [DrawnScene("alone", (thing,), (0,), None, WHITE, line) for thing in (wished, there)]
    wanted, begun = (render_scene(scene, [0], medium, side_px=side_px) for scene in scenes)
    canvas = begun.image
    if medium == "colour":
        fill = generator.uniform(*_FILL_SRGB, size=3)
        canvas = np.where(begun.regions[..., None] > 0, np.round(canvas / 255 * fill), canvas).astype(np.uint8)
    return Case(f"begun_{number:04d}", phrase(asked), (asked,), wanted.image, canvas, (other,))


def paper_cases(held_out: pa.Table, count: int) -> list[Case]:
    """Prompts of up to `count` scenes in the table's order, for a blank sheet.

    Raises:
        ContractError: fewer than two scenes, or pictures that are not squares of one size.
    """
    rows = [_read(row, number) for number, row in enumerate(held_out.slice(0, max(count, 2)).to_pylist())]
    _check(rows)
    return [
        Case(row.scene_id, row.caption, row.objects, row.image, np.full_like(row.image, 255), ())
        for row in rows[:count]
    ]  # fmt: skip


def composed_cases(
    count: int, split: str, medium: DrawingMedium, *, vocabulary: Vocabulary, side_px: int, seed: int
) -> list[Case]:
    """`count` requests for several named things in a relation of `split` (`split_of_scene`), for a blank sheet.

    The requested scene is OpenMoji's drawing of each thing in the window that the request gives it. Case i depends on
    (split, medium, vocabulary, seed, i) only.
    """
    return [
        _composed(f"{split}_{index:04d}", split, medium, vocabulary, side_px, np.random.default_rng([seed, index]))
        for index in range(count)
    ]


def _composed(
    name: str, split: str, medium: DrawingMedium, vocabulary: Vocabulary, side_px: int, generator: np.random.Generator
) -> Case:
    scene = draw_scene(
        split, nouns_of("openmoji"), "openmoji", alone_share=0.0, tinted_share=0.0, places="usual",
        generator=generator,
    )  # fmt: skip
    words = caption(scene, generator)
    request = understand(words, vocabulary)
    wishes = arranged(request.things, in_a_row=request.in_a_row)
    noun_of = {phrase(noun): noun for noun in vocabulary.nouns}
    nouns = tuple(noun_of[wish.words] for wish in wishes)
    windows = tuple(wish.window for wish in wishes)
    things = tuple(
        Placed(noun, "openmoji", window.x, window.y, THING * window.size, 0.0, False)
        for noun, window in zip(nouns, windows, strict=True)
    )
    drawn = replace(scene, things=things, named=tuple(range(len(things))))
    image = render_scene(drawn, range(len(things)), medium, side_px=side_px).image
    return Case(name, words, nouns, image, np.full_like(image, 255), (), windows)


@dataclass(frozen=True, eq=False)
class _Row:
    scene_id: str
    caption: str
    objects: tuple[str, ...]
    image: Picture
    regions: Picture

    @property
    def things(self) -> int:
        return len(labels_of(self.regions))


def _read(row: dict[str, Any], number: int) -> _Row:
    objects = tuple(str(kind) for kind in (row.get("objects") or ()))
    name = str(row.get("scene_id") or number)
    return _Row(name, plain_caption(row), objects, *read_scene(row, f"Scene {name}"))


def _check(rows: Sequence[_Row]) -> None:
    if len(rows) < 2:
        raise ContractError(
            f"There are {len(rows)} held-out scenes; an evaluation needs two or more: draw more scenes."
        )
    sizes = {row.image.shape for row in rows}
    if len(sizes) > 1 or next(iter(sizes))[0] != next(iter(sizes))[1]:
        raise ContractError(f"The held-out scenes are of sizes {sorted(sizes)[:3]}; make them squares of one size.")


def _in_half(row: _Row, half: Half, generator: np.random.Generator) -> Picture:
    """The things of the scene in one half of the sheet, on the background of the scene."""
    ground = without(row.image, row.regions, labels_of(row.regions))
    return put(ground, row.image, row.regions, half=half, generator=generator)[0]


def plain_caption(row: Mapping[str, Any]) -> str:
    """The first caption of a scene without its colours, because one ink shows none; else the first."""
    return without_colors([str(text) for text in (row.get("captions") or [row["caption"]])], row.get("colors"))[0]


def _other(row: _Row, others: Sequence[_Row], seen: Collection[frozenset[str]], generator: np.random.Generator) -> _Row:
    """The first candidate whose kinds no training scene combines with those of the row; else the first of other kinds;
    else any.
    """
    drawn = [others[int(pick)] for pick in generator.integers(len(others), size=_TRIES)]
    drawn = [other for other in drawn if other.scene_id != row.scene_id] or [
        other for other in others if other is not row
    ]
    apart = [other for other in drawn if not set(row.objects) & set(other.objects)]
    new = [
        other
        for other in apart
        if not any(frozenset((a, b)) in seen for a in row.objects for b in other.objects)
    ]  # fmt: skip
    return (new or apart or drawn)[0]
