"""Scenes cut out and combined: things removed, or placed in one half of a sheet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, islice
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png, image_cell
from pentimento.contracts.scenes import CONTRACT, labels_of, read_scene
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.drawings.scenes import split_of_scene
from pentimento.copainting.drawings.sources import LICENCES

_EXTENT: Final = (0.44, 0.52)  # range of the longer side of a placed cut-out, in sides of the sheet
_JITTER: Final = 0.03  # largest offset of a cut-out from its half's centre along each axis, in sides of the sheet
_MARGIN_PX: Final = 2  # around a removed region: its antialiased edge
_AROUND_SIZES: Final = (0.5, 1.6)
_OVER_SHARE: Final = 0.25
_BESIDE: Final = (0.8, 1.1)  # range of the distance of centres, where the squares of both touch at 1
_OVER: Final = (0.2, 0.8)
PAPER_SRGB: Final = 250
"""Grey of white paper."""

_NAMES: Final = ("left", "right", "upper", "lower")


class Half(NamedTuple):
    """The centre of a half of the sheet, in sides of the sheet: x to the right, y down."""

    x: float
    y: float


HALVES: Final = ((Half(0.26, 0.5), Half(0.74, 0.5)), (Half(0.5, 0.26), Half(0.5, 0.74)))
"""Left and right; upper and lower."""
_PLACES: Final = [half for pair in HALVES for half in pair]  # in the order of `_NAMES`


def without(image: NDArray[np.uint8], regions: NDArray[np.uint8], labels: NDArray[np.integer]) -> NDArray[np.uint8]:
    """The picture with the regions of these labels filled by the background.

    Each row is filled with the median of the background that the row shows, or of all background if it shows none.
    Backgrounds change from top to bottom more than from left to right, and inpainting would leave visible traces.
    """
    margin = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)
    objects = cv2.dilate((regions > 0).astype(np.uint8), margin) > 0
    removed = (cv2.dilate(np.isin(regions, labels).astype(np.uint8), margin) > 0) & ~(
        (regions > 0) & ~np.isin(regions, labels)  # what stays is not touched, also where it touches what goes
    )
    blank = np.full((1, 3), PAPER_SRGB)
    overall = np.median(image[~objects] if not objects.all() else blank, axis=0)
    fill = np.stack(
        [
            np.median(row[~covered], axis=0) if not covered.all() else overall
            for row, covered in zip(image, objects, strict=True)
        ]
    ).astype(np.uint8)
    return np.where(removed[..., None], fill[:, None], image)


def random_halves(generator: np.random.Generator) -> tuple[Half, Half]:
    """Two facing halves of the sheet, in random order."""
    one, other = HALVES[int(generator.integers(len(HALVES)))]
    return (one, other) if generator.random() < 0.5 else (other, one)


def put(
    sheet: NDArray[np.uint8],
    picture: NDArray[np.uint8],
    regions: NDArray[np.uint8],
    *,
    half: Half,
    generator: np.random.Generator,
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """A copy of the sheet, sRGB [H, W, 3], with all things of a picture [h, w, 3] in one half; and their mask [H, W].

    All pixels with a label above 0 in `regions` [h, w] are cut out together and resized. A picture without things
    changes nothing.
    """
    height, width = sheet.shape[:2]
    objects = regions > 0
    if not objects.any():
        return sheet.copy(), np.zeros((height, width), bool)
    rows, columns = np.flatnonzero(objects.any(1)), np.flatnonzero(objects.any(0))
    extent = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    scale = generator.uniform(*_EXTENT) * min(height, width) / extent
    offset = generator.uniform(-_JITTER, _JITTER, 2)
    middle = (half.x + offset[0]) * width, (half.y + offset[1]) * height
    centre = (columns[0] + columns[-1] + 1) / 2, (rows[0] + rows[-1] + 1) / 2
    # OpenCV's pixel centres are at whole numbers.
    shift = [middle[axis] - 0.5 - scale * (centre[axis] - 0.5) for axis in range(2)]
    moved = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    size, way = (width, height), cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    image = cv2.warpAffine(picture, moved, size, flags=way, borderMode=cv2.BORDER_REPLICATE)
    share = cv2.warpAffine(objects.astype(np.float32), moved, size, flags=cv2.INTER_LINEAR)[..., None]
    mixed = np.round(sheet + (image.astype(np.float64) - sheet) * share).astype(np.uint8)
    return mixed, share[..., 0] >= 0.5


class Place(NamedTuple):
    """A square on a sheet, in sides of the sheet: its centre, x to the right and y down, and its side."""

    x: float
    y: float
    size: float


def place_around(generator: np.random.Generator) -> Place:
    """A random place for a thing that stands around another one, which fills the sheet, or overlaps with it.

    Part of it may lie outside: the sheet may be a small window of a larger one.
    """
    size = float(generator.uniform(*_AROUND_SIZES))
    reach = _OVER if generator.random() < _OVER_SHARE else _BESIDE
    across, along = (size + 1) / 2 * generator.uniform(*reach) * generator.choice((-1, 1)), generator.uniform(-0.5, 0.5)
    x, y = (across, along) if generator.random() < 0.5 else (along, across)
    return Place(0.5 + float(x), 0.5 + float(y), size)


def pairs_shown(objects: Iterable[Sequence[str]]) -> set[frozenset[str]]:
    """The pairs of kinds that occur in one scene: sets of two kinds, or of one kind that occurs twice."""
    return {
        frozenset((one, other))
        for kinds in objects
        for number, one in enumerate(kinds)
        for other in kinds[number + 1 :]
    }  # fmt: skip


def pairs_in_training(scenes: pa.Table) -> set[frozenset[str]]:
    """The pairs of kinds that pictures for training may show together.

    For drawings of named things, a hash of the words decides it (`split_of_scene`); few of those pairs occur in a small
    table. For other `scenes`, those that occur in one scene; empty without `objects`.
    """
    if "objects" not in scenes.column_names:
        return set()
    objects = [kinds or () for kinds in scenes["objects"].to_pylist()]
    if not shows_named_things(scenes):
        return pairs_shown(objects)
    kinds = sorted({kind for each in objects for kind in each})
    return {frozenset(pair) for pair in combinations(kinds, 2) if split_of_scene("beside", pair) == "train"}


def shows_named_things(scenes: pa.Table) -> bool:
    """Whether all scenes of a checked table are drawings of named things, each of which fills its window."""
    return set(scenes["source"].to_pylist()) <= LICENCES.keys()


def as_drawn(scenes: pa.Table, *, with_pen: bool) -> pa.Table:
    """Scenes as a tool draws them: `with_pen`, their pen drawings take the place of their pictures.

    Raises:
        ContractError: a scene has no pen drawing.
    """
    if not with_pen:
        return scenes
    if "pen" not in scenes.column_names or scenes["pen"].null_count:
        raise ContractError("The scenes have no pen drawings; set ink, which converts their pictures to ink.")
    place = scenes.column_names.index("image")
    return scenes.set_column(place, scenes.schema.field("image"), scenes["pen"])


def half_scenes(scenes: pa.Table, count: int, seed: int) -> pa.Table:
    """`count` rows of the `scenes` contract: the thing of a scene with one thing, placed in one half of its background.

    The rows use the first such scenes of a checked table that has `scene_id` and `split`. If there are fewer than
    `count`, scenes repeat in another half. `arrangement` names the half: left, right, upper or lower, in turn. Row i
    depends on the table and (seed, i) only.

    Raises:
        ContractError: no scene has exactly one thing.
    """
    alone = list(
        islice((row for row in scenes.to_pylist() if len(labels_of(decode_png(row["regions"]["bytes"]))) == 1), count)
    )
    if count and not alone:
        raise ContractError("No scene shows one thing alone, to be put in one half of a sheet: ask for no half scenes.")
    rows = [_half(alone[i % len(alone)], (i + i // len(alone)) % len(_NAMES), [seed, i]) for i in range(count)]
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def opposite(name: str) -> str:
    """The half that faces a half, by name."""
    place = _NAMES.index(name)
    return _NAMES[place + 1 if place % 2 == 0 else place - 1]


def _half(row: dict[str, Any], place: int, seed: list[int]) -> dict[str, Any]:
    generator = np.random.default_rng(seed)
    image, regions = read_scene(row, f"Scene {row['scene_id']}")
    half: Half = _PLACES[place]
    ground = without(image, regions, labels_of(regions))
    moved, there = put(ground, image, regions, half=half, generator=generator)
    return row | {
        "image": image_cell(moved),
        "regions": image_cell(there.astype(np.uint8)),
        "scene_id": f"{row['scene_id']}/{_NAMES[place]}",
        "arrangement": _NAMES[place],
    }
