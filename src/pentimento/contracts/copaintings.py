"""The `copaintings` table: pairs of a partial and a full painting, for training the goal planner."""

from typing import Any, Final

import numpy as np
import pyarrow as pa

from pentimento.contracts import scenes
from pentimento.contracts.images import decode_png, encode_png
from pentimento.contracts.schema import IMAGE, TableContract, arrow_schema, known, needed

STRATEGIES: Final = ("all", "random", "salient", "semantic", "beside")
SPLITS: Final = ("train", "val", "test")

CONTRACT: Final = TableContract(
    name="copaintings",
    description="One row for each pair of a partial and a full painting of a captioned scene.",
    columns=(
        needed("scene_id", pa.string(), "which scene"),
        needed("setting", pa.string(), "paints and tool, e.g. marker"),
        needed(
            "strategy",
            pa.string(),
            "which strokes are missing: those removed, or those of a thing beside",
            choices=STRATEGIES,
        ),
        known("region", pa.int32(), "label of the region that was removed (semantic); null otherwise"),
        needed("seed", pa.int64(), "seed of the plan and of the removal"),
        needed("caption", pa.string(), "of the scene, or of what is missing"),
        known("medium", pa.string(), "what a request says of the medium: with a marker"),
        needed("partial", IMAGE, "PNG of the painting without the removed strokes", "", "image"),
        needed("full", IMAGE, "PNG of the full painting", "", "image"),
        needed("plan_id", pa.string(), "which plan painted it; two, where one thing is beside another"),
        needed("kept", pa.list_(pa.bool_()), "for each stroke of the plan, whether the partial shows it"),
        needed("clip_score", pa.float32(), "of the full painting against the caption"),
        needed("scorer", pa.string(), "digest of the model that scored"),
        needed("split", pa.string(), "train, val or test; by scene", choices=SPLITS),
    ),
)

_STROKES: Final = 12


def example_table(n: int, seed: int = 0) -> pa.Table:
    """`n` pairs: an example scene, and it with bands left blank; row i depends on (seed, i) only."""
    pictures = scenes.example_table(n, seed).to_pylist()
    rows = [_example_row(index, picture, seed) for index, picture in enumerate(pictures)]
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def _example_row(index: int, scene: dict[str, Any], seed: int) -> dict[str, Any]:
    generator = np.random.default_rng([seed, index, 1])
    strategy = STRATEGIES[index % len(STRATEGIES)]
    kept = np.zeros(_STROKES, bool) if strategy == "all" else generator.random(_STROKES) < 0.5
    full = decode_png(scene["image"]["bytes"])
    band = np.arange(full.shape[0]) * _STROKES // full.shape[0]
    partial = np.where(kept[band][:, None, None], full, np.uint8(245)).astype(np.uint8)
    return {
        "scene_id": f"example_{seed}_{index}",
        "setting": "marker",
        "strategy": strategy,
        "region": 1 if strategy == "semantic" else None,
        "seed": seed,
        "caption": scene["caption"],
        "partial": {"bytes": encode_png(partial), "path": None},
        "full": scene["image"],
        "plan_id": f"plan_{index}",
        "kept": kept.tolist(),
        "clip_score": float(generator.uniform(0.2, 0.35)),
        "scorer": "example",
        "split": SPLITS[(0, 0, 0, 1, 2)[index % 5]],
    }
