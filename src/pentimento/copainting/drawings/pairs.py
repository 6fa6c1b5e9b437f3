"""Pairs of a begun and a finished drawing of a scene with named things, and the scenes themselves as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
    DrawnScene,
    Medium,
    Places,
    Rendered,
    caption,
    caption_of,
    draw_scene,
    moved,
    render_scene,
)
from pentimento.copainting.drawings.sources import LICENCES, PEN_SOURCES, Source, nouns_of
from pentimento.copainting.scenes.edits import Pair
from pentimento.copainting.scenes.ink import random_strokes

MEDIUM_WORDS: Final[dict[Medium, str]] = {"marker": MARKER_WORDS, "colour": COLOUR_WORDS}
"""What the request of a pair says of its medium."""
_MEDIA: Final[tuple[Medium, ...]] = ("marker", "colour")
_BLANK_SHARE: Final = 0.4  # of the pairs of scenes with several things: the canvas is blank
_BEGUN_SHARE: Final = 0.15  # of the pairs: part of a missing thing is drawn already
_SCRIBBLE_SHARE: Final = 0.1  # of the pairs: the canvas shows other strokes, which the finished drawing keeps
_MISSING_SHARE: Final = 0.6  # of the requests: they name the missing things, not the whole scene
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
    sources: tuple[Source, ...]
    """A scene is drawn by one of these, and shows only things that the source draws."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "scenes", "wordings")
        at_least(self, 32, "side_px")
        at_least(self, 0, "val_share", "test_share", "pen_share", "alone_share", "mirrored_share", "seed")
        if max(self.val_share + self.test_share, self.pen_share, self.alone_share, self.mirrored_share) > 1:
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
    count: int,
    split: str,
    nouns: Sequence[str],
    *,
    alone_share: float,
    tidy_share: float = 0.0,
    side_px: int,
    seed: int,
) -> list[Pair]:
    """`count` pairs of scenes of a split, which OpenMoji draws; pair i depends on (seed, i) only.

    The request ends with the words of the medium. The canvas shows some or none of the things, each of them whole
    except for one that may be half drawn; it may also show strokes that belong to nothing.

    In `tidy_share` of the pairs, what is to be added stands in its usual place, and what is there is moved at random.
    These are learned sooner: then words and canvas decide where a thing goes.
    """
    generators = (np.random.default_rng([seed, index]) for index in range(count))
    return [_pair(split, nouns, alone_share, tidy_share, side_px, generator) for generator in generators]


def _pair(
    split: str,
    nouns: Sequence[str],
    alone_share: float,
    tidy_share: float,
    side_px: int,
    generator: np.random.Generator,
) -> Pair:
    alone, begun = generator.random() < alone_share, generator.random() < _BEGUN_SHARE
    blank = alone or generator.random() < _BLANK_SHARE
    tidy = generator.random() < tidy_share
    places: Places = "usual" if tidy else "anywhere"
    scene = draw_scene(split, nouns, "openmoji", alone_share=float(alone), places=places, generator=generator)
    medium = _MEDIA[int(generator.integers(len(_MEDIA)))]
    number = len(scene.things)
    missing = set(range(number))
    if not blank:
        missing = set(generator.permutation(number)[: int(generator.integers(1, number))].tolist())
    kept = set(range(number)) - missing
    if tidy:
        scene = moved(scene, kept, generator)
    full = render_scene(scene, range(number), medium, side_px=side_px).image
    canvas = render_scene(scene, kept, medium, side_px=side_px).image
    if begun:
        canvas = _begun(scene, kept, sorted(missing)[0], canvas, medium, generator)
    if generator.random() < _SCRIBBLE_SHARE:
        canvas, full = _scribbled(canvas, full, generator)
    whole = number == 1 or not kept or generator.random() >= _MISSING_SHARE
    request = caption(scene, generator) if whole else caption_of(scene, missing, generator)
    return Pair(canvas, full, with_medium(request, MEDIUM_WORDS[medium]))


def _begun(
    scene: DrawnScene,
    kept: set[int],
    begun: int,
    canvas: NDArray[np.uint8],
    medium: Medium,
    generator: np.random.Generator,
) -> NDArray[np.uint8]:
    """The canvas with the part of a missing thing that lies on one side of a random line through it."""
    side = canvas.shape[0]
    thing = scene.things[begun]
    angle = generator.uniform(0, 2 * np.pi)
    y, x = (np.mgrid[:side, :side] + 0.5) / side
    reach = (x - thing.x) * np.cos(angle) + (y - thing.y) * np.sin(angle) < generator.uniform(-0.2, 0.1) * thing.size
    return np.where(reach[..., None], render_scene(scene, kept | {begun}, medium, side_px=side).image, canvas)


def _scribbled(
    canvas: NDArray[np.uint8], full: NDArray[np.uint8], generator: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Both pictures with the same random strokes on top."""
    side = canvas.shape[0]
    widths = (_SCRIBBLE_WIDTHS[0] * side, _SCRIBBLE_WIDTHS[1] * side)
    strokes = random_strokes(side, int(generator.integers(*_SCRIBBLES)), widths, generator).astype(np.float64)
    through = strokes / strokes.max((0, 1))  # of white paper: 1 where nothing is drawn
    return np.round(canvas * through).astype(np.uint8), np.round(full * through).astype(np.uint8)
