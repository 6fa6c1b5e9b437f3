"""Pairs of a begun and a finished drawing of a scene with named things, and the scenes themselves as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.images import image_cell
from pentimento.contracts.ranges import at_least
from pentimento.contracts.requests import COLOUR_WORDS, MARKER_WORDS, with_medium
from pentimento.contracts.scenes import CONTRACT, split_of
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.drawings.scenes import (
    Medium,
    Placed,
    Places,
    Rendered,
    caption,
    draw_scene,
    render_scene,
    split_of_scene,
)
from pentimento.copainting.drawings.sources import LICENCES, PEN_SOURCES, Source, nouns_of
from pentimento.copainting.scenes.collage import place_around
from pentimento.copainting.scenes.edits import Pair
from pentimento.copainting.scenes.ink import random_strokes

MEDIUM_WORDS: Final[dict[Medium, str]] = {"marker": MARKER_WORDS, "colour": COLOUR_WORDS}
"""What the request of a pair says of its medium."""
_MEDIA: Final[tuple[Medium, ...]] = ("marker", "colour")
_BEGUN_SHARE: Final = 0.12  # of the pairs: part of the asked thing is drawn already
_SCRIBBLE_SHARE: Final = 0.1  # of the pairs: the canvas shows other strokes, which the finished drawing keeps
_OTHERS: Final = (1, 4)  # range of the number of other things; the second is excluded
_OTHER_LINES: Final = (0.018, 0.05)  # least width of their lines
_OTHER_TURN_RAD: Final = np.radians(6)
_SCRIBBLES: Final = (1, 8)
_SCRIBBLE_WIDTHS: Final = (0.012, 0.025)  # in sides of the picture


@dataclass(frozen=True)
class DrawnScenesConfig:
    """How many scenes are drawn for encoders, and how."""

    scenes: int
    side_px: int
    val_share: float
    test_share: float
    pen_share: float
    """Of the scenes of a source with pen drawings: the picture is the pen drawing, which column `pen` holds anyway."""
    wordings: int
    """Captions of each scene."""
    alone_share: float
    """Of the scenes: those with one thing."""
    mirrored_share: float
    """Of the things."""
    tinted_share: float
    """Of the scenes: in colour, the sheet has a pale tint, not that of white paper."""
    places: Places
    """Where things stand."""
    sources: tuple[Source, ...]
    """A scene is drawn by one of these, and shows only things that the source draws."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "scenes", "wordings")
        at_least(self, 32, "side_px")
        shares = ("pen_share", "alone_share", "mirrored_share", "tinted_share")
        at_least(self, 0, "val_share", "test_share", *shares, "seed")
        if max(self.val_share + self.test_share, *(getattr(self, share) for share in shares)) > 1:
            raise ValueError("A share of the scenes or of the things is above 1; give fractions.")


def drawn_scenes(config: DrawnScenesConfig, archives: Path | None) -> pa.Table:
    """A table of the `scenes` contract; row i depends on (seed, i) only. `archives` as for `named_drawing`.

    The splits `train` and `val` share compositions; `test` shows held-out ones. A scene with one thing is in any split.
    """
    rows = [_row(index, config, archives) for index in range(config.scenes)]
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def _row(index: int, config: DrawnScenesConfig, archives: Path | None) -> dict[str, Any]:
    generator = np.random.default_rng([config.seed, index])
    split = split_of(generator.random(), config.val_share, config.test_share)
    source = config.sources[index // 2 % len(config.sources)]
    scene = draw_scene(
        "test" if split == "test" else "train",
        nouns_of(source, archives),
        source,
        alone_share=config.alone_share,
        mirrored_share=config.mirrored_share,
        tinted_share=config.tinted_share,
        places=config.places,
        generator=generator,
    )
    everything = range(len(scene.things))
    has_pen = source in PEN_SOURCES
    media: dict[Medium, Rendered] = {
        medium: render_scene(scene, everything, medium, side_px=config.side_px, archives=archives)
        for medium in _MEDIA
        if has_pen or medium == "colour"
    }
    rendered = media["marker" if has_pen and generator.random() < config.pen_share else "colour"]
    captions = [caption(scene, generator) for _ in range(config.wordings)]
    return {
        "image": image_cell(rendered.image),
        "caption": captions[0],
        "regions": image_cell(rendered.regions),
        "source": source,
        "licence": LICENCES[source],
        "scene_id": f"drawn_{config.seed}_{index:06d}",
        "split": split,
        "captions": captions,
        "objects": [thing.noun for thing in scene.things],
        "colors": [],
        "arrangement": scene.relation,
        "ground": "line" if scene.ground_y is not None else "none",
        "pen": image_cell(media["marker"].image) if has_pen else None,
    }


def drawn_pairs(
    count: int, split: str, nouns: Sequence[str], *, blank_share: float, side_px: int, seed: int
) -> list[Pair]:
    """`count` pairs of a window of a canvas and the same window with one more thing; pair i depends on (seed, i) only.

    The asked thing fills the window. The canvas is blank in `blank_share` of the pairs; in the others it shows things
    or parts of things that stand around the asked one, or overlap with it. Their nouns and the asked one are pairs of
    `split` (`split_of_scene`). A marker draws over what is there; in colours, the asked thing hides what is there or
    is hidden by it. A part of the asked thing may be drawn already, and the canvas may show strokes that belong to
    nothing. OpenMoji draws all things. The request ends with the words of the medium.
    """
    generators = (np.random.default_rng([seed, index]) for index in range(count))
    return [_pair(split, nouns, blank_share, side_px, generator) for generator in generators]


def _pair(split: str, nouns: Sequence[str], blank_share: float, side_px: int, generator: np.random.Generator) -> Pair:
    alone = draw_scene(split, nouns, "openmoji", alone_share=1.0, places="usual", generator=generator)
    medium = _MEDIA[int(generator.integers(len(_MEDIA)))]
    asked, there = alone.things[0], _others(alone.things[0].noun, split, nouns, generator)
    if generator.random() < blank_share:
        there = []
    behind = generator.random() < 0.5
    things = (asked, *there) if behind else (*there, asked)
    scene, place = replace(alone, things=things), 0 if behind else len(there)
    kept = set(range(len(things))) - {place}
    canvas = render_scene(scene, kept, medium, side_px=side_px).image
    if medium == "marker":  # lines cross: ink stays
        full = np.minimum(canvas, render_scene(scene, {place}, medium, side_px=side_px).image)
    else:
        full = render_scene(scene, range(len(things)), medium, side_px=side_px).image
    if generator.random() < _BEGUN_SHARE:
        canvas = _begun(canvas, full, asked, generator)
    if generator.random() < _SCRIBBLE_SHARE:
        canvas, full = _scribbled(canvas, full, generator)
    return Pair(canvas, full, with_medium(caption(alone, generator), MEDIUM_WORDS[medium]))


def _others(asked: str, split: str, nouns: Sequence[str], generator: np.random.Generator) -> list[Placed]:
    """Things around the centre of a window; parts of them may lie outside."""
    found = []
    for _ in range(int(generator.integers(*_OTHERS))):
        noun = asked
        while noun == asked or split_of_scene("beside", (asked, noun)) != split:
            noun = nouns[int(generator.integers(len(nouns)))]
        x, y, size = place_around(generator)
        line, turn = float(generator.uniform(*_OTHER_LINES)), float(generator.normal(0, _OTHER_TURN_RAD))
        found.append(Placed(noun, "openmoji", x, y, size, turn, bool(generator.random() < 0.5), line))
    return found


def _begun(
    canvas: NDArray[np.uint8], full: NDArray[np.uint8], asked: Placed, generator: np.random.Generator
) -> NDArray[np.uint8]:
    """The canvas with the part of the finished drawing that lies on one side of a random line through what is asked."""
    side = canvas.shape[0]
    angle = generator.uniform(0, 2 * np.pi)
    y, x = (np.mgrid[:side, :side] + 0.5) / side
    reach = (x - asked.x) * np.cos(angle) + (y - asked.y) * np.sin(angle) < generator.uniform(-0.2, 0.1) * asked.size
    return np.where(reach[..., None], full, canvas)


def _scribbled(
    canvas: NDArray[np.uint8], full: NDArray[np.uint8], generator: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Both pictures with the same random strokes on top."""
    side = canvas.shape[0]
    widths = (_SCRIBBLE_WIDTHS[0] * side, _SCRIBBLE_WIDTHS[1] * side)
    strokes = random_strokes(side, int(generator.integers(*_SCRIBBLES)), widths, generator).astype(np.float64)
    through = strokes / strokes.max((0, 1))  # of white paper: 1 where nothing is drawn
    return np.round(canvas * through).astype(np.uint8), np.round(full * through).astype(np.uint8)
