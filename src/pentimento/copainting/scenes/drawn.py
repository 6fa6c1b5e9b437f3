"""Captioned scenes with regions, drawn by procedure: the data that co-painting begins with where none is given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.images import encode_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.scenes import CONTRACT, SPLITS
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.scenes.captions import wordings
from pentimento.copainting.scenes.compositions import Composition, Splits, compose
from pentimento.copainting.scenes.drawing import Drawing, arrange, paint

SOURCE: Final = "drawn by pentimento"
LICENCE: Final = "CC0-1.0"


@dataclass(frozen=True)
class ScenesConfig:
    """Scenes to draw."""

    scenes: int
    side_px: int
    val_share: float
    test_share: float
    wordings: int
    """Captions for each scene."""
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "scenes", "wordings")
        at_least(self, 16, "side_px")
        at_least(self, 0, "val_share", "test_share", "seed")
        if self.val_share + self.test_share >= 1:
            raise ValueError(
                f"val_share and test_share are {self.val_share} and {self.test_share}; leave a share for training."
            )


@dataclass(frozen=True, eq=False)
class Scene:
    """One scene, before it is drawn at a size."""

    split: str
    composition: Composition
    captions: list[str]
    drawing: Drawing


def scene(item: int, config: ScenesConfig, splits: Splits) -> Scene:
    """Scene ``item``: it depends on the seed and on its own number only, not on how many there are."""
    generator = np.random.default_rng([config.seed, 1, item])
    split = _split(generator.random(), config)
    composition = compose(split, splits, generator)
    return Scene(
        split, composition, wordings(composition, config.wordings, generator), arrange(composition, generator)
    )  # fmt: skip


def build_scenes(config: ScenesConfig, log: Callable[[str, float, int], None]) -> pa.Table:
    """The table of all scenes in the ``scenes`` contract, in the order of their numbers."""
    splits = Splits(config.seed)
    rows = []
    for item in range(config.scenes):
        rows.append(_row(item, scene(item, config, splits), config.side_px))
        if (item + 1) % 1000 == 0:
            log("scenes", item + 1, item + 1)
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def _split(chance: float, config: ScenesConfig) -> str:
    bounds: NDArray[np.float64] = np.cumsum([1 - config.val_share - config.test_share, config.val_share])
    return SPLITS[int(np.searchsorted(bounds, chance, side="right"))]


def _row(item: int, made: Scene, side_px: int) -> dict[str, Any]:
    image, regions = paint(made.drawing, side_px)
    return {
        "image": {"bytes": encode_png(image), "path": None},
        "caption": made.captions[0],
        "regions": {"bytes": encode_png(regions), "path": None},
        "source": SOURCE,
        "licence": LICENCE,
        "scene_id": f"scene_{item:06d}",
        "split": made.split,
        "captions": made.captions,
        "objects": [thing.kind for thing in made.composition.things],
        "colors": [thing.color for thing in made.composition.things],
        "arrangement": made.composition.arrangement,
        "ground": made.composition.ground,
    }
