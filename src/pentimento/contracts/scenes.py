"""The `scenes` table: captioned pictures with regions, from which co-paintings are made."""

from typing import Any, Final

import numpy as np
import pyarrow as pa

from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import IMAGE, TableContract, arrow_schema, needed

CONTRACT: Final = TableContract(
    name="scenes",
    description="One row for each captioned picture, with a label mask of its regions.",
    columns=(
        needed("image", IMAGE, "PNG, RGB", "", "image"),
        needed("caption", pa.string(), "what a person would say it shows"),
        needed("regions", IMAGE, "8-bit PNG of labels, as large as the image; 0 = background", "", "image"),
        needed("source", pa.string(), "where it comes from"),
        needed("licence", pa.string(), "under which licence"),
    ),
)

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
        "image": {"bytes": encode_png(image), "path": None},
        "caption": f"a {colour} {shape} on a {ground} ground",
        "regions": {"bytes": encode_png(inside.astype(np.uint8)), "path": None},
        "source": "example",
        "licence": "CC0-1.0",
    }
