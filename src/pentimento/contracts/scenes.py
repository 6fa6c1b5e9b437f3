"""The `scenes` table: captioned pictures with regions, from which co-paintings are made."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png, image_cell
from pentimento.contracts.schema import IMAGE, TableContract, arrow_schema, known, needed

SPLITS: Final = ("train", "val", "test")

CONTRACT: Final = TableContract(
    name="scenes",
    description="One row for each captioned picture, with a label mask of its regions.",
    columns=(
        needed("image", IMAGE, "PNG, RGB", "", "image"),
        needed("caption", pa.string(), "what a person would say it shows"),
        needed("regions", IMAGE, "8-bit PNG of labels, as large as the image; 0 = background", "", "image"),
        needed("source", pa.string(), "where it comes from"),
        needed("licence", pa.string(), "under which licence"),
        known("scene_id", pa.string(), "which scene"),
        known("split", pa.string(), "train, val or test", choices=SPLITS),
        known("captions", pa.list_(pa.string()), "several wordings of what it shows, `caption` among them"),
        known("objects", pa.list_(pa.string()), "kinds of things; number i is region i + 1"),
        known("colors", pa.list_(pa.string()), "of the objects, in their order"),
        known("arrangement", pa.string(), "how the objects stand to each other"),
        known("ground", pa.string(), "what they stand before"),
        known("pen", IMAGE, "PNG, RGB: the same picture drawn with a pen, as large as the image", "", "image"),
    ),
)


def read_scene(row: Mapping[str, Any], name: str) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """The picture [H, W, 3] and the region labels [H, W] of a row; `name` says which scene it is.

    Raises:
        ContractError: the labels have another size than the picture.
    """
    image, regions = decode_png(row["image"]["bytes"]), decode_png(row["regions"]["bytes"])
    if regions.shape != image.shape[:2]:
        raise ContractError(f"{name}: its regions are {regions.shape}, its image {image.shape[:2]}; match them.")
    return image, regions


def labels_of(regions: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """The labels of the objects in a mask, rising; 0 is the background."""
    return np.unique(regions[regions > 0])


def without_colors(captions: Sequence[str], colors: Sequence[str] | None) -> list[str]:
    """The captions that name none of these colours; all captions if each names one."""
    named = set(colors or ())
    return [text for text in captions if not named & set(text.replace(",", " ").split())] or list(captions)


def split_of(chance: float, val_share: float, test_share: float) -> str:
    """The split of an item with a uniform random number in [0, 1): first `train`, then `val`, then `test`."""
    bounds: npt.NDArray[np.float64] = np.cumsum([1 - val_share - test_share, val_share])
    return SPLITS[int(np.searchsorted(bounds, chance, side="right"))]


WITHOUT_ARTICLE: Final = frozenset({
    "bread", "broccoli", "cheese", "cherries", "chips", "corn", "crossed swords", "dice", "french fries", "fries",
    "glasses", "gloves", "grapes", "headphones", "honey", "ice", "jeans", "maize", "milk", "pancakes", "pants",
    "peanuts", "piano keys", "popcorn", "scissors", "shades", "shorts", "skis", "soap", "socks", "spectacles",
    "sunglasses", "table tennis", "ping pong", "tennis", "trainers", "trousers", "crutches",
})  # fmt: skip
"""Kinds in the plural, and substances."""


def phrase(kind: str, color: str | None = None) -> str:
    """A kind of object with its article, where it has one, and its colour: "an orange cup", "scissors"."""
    words = kind if color is None else f"{color} {kind}"
    return words if kind in WITHOUT_ARTICLE else f"{'an' if words[:1] in 'aeiou' else 'a'} {words}"


def listed(phrases: Sequence[str]) -> str:
    """Phrases as an enumeration: "a car, a tree and a sun"."""
    return phrases[0] if len(phrases) == 1 else f"{', '.join(phrases[:-1])} and {phrases[-1]}"


_SIDE_PX: Final = 64
_COLOURS: Final = {
    "red": (200, 40, 40),
    "blue": (40, 70, 190),
    "green": (50, 140, 60),
    "yellow": (230, 200, 40),
}
_GROUNDS: Final = {"white": (240, 240, 238), "grey": (150, 150, 152)}


def example_table(n: int, seed: int = 0) -> pa.Table:
    """`n` pictures of a coloured disc or square on a plain ground; row i depends on (seed, i) only."""
    rows = [_example_row(index, seed) for index in range(n)]
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def _example_row(index: int, seed: int) -> dict[str, Any]:
    generator = np.random.default_rng([seed, index])
    colour, ground = generator.choice(list(_COLOURS)), generator.choice(list(_GROUNDS))
    shape = generator.choice(["disc", "square"])
    column, row = generator.uniform(20, 44, size=2)
    radius = generator.uniform(8, 18)
    columns, rows = np.meshgrid(np.arange(_SIDE_PX), np.arange(_SIDE_PX))
    dx, dy = np.abs(columns - column), np.abs(rows - row)
    inside = (np.hypot(dx, dy) if shape == "disc" else np.maximum(dx, dy)) < radius
    image = np.where(inside[..., None], _COLOURS[colour], _GROUNDS[ground]).astype(np.uint8)
    return {
        "image": image_cell(image),
        "caption": f"a {colour} {shape} on a {ground} ground",
        "regions": image_cell(inside.astype(np.uint8)),
        "source": "example",
        "licence": "CC0-1.0",
        "scene_id": f"example_{seed}_{index}",
        "split": SPLITS[(0, 0, 0, 1, 2)[index % 5]],
        "captions": [f"a {colour} {shape} on a {ground} ground", f"a {shape}"],
        "objects": [str(shape)],
        "colors": [str(colour)],
        "arrangement": "alone",
        "ground": str(ground),
    }
