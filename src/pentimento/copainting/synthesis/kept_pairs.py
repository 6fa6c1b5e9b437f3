"""Which pairs a dataset of co-paintings keeps, and what there is to say of them in numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pentimento.contracts.copaintings import CONTRACT, SPLITS, STRATEGIES
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png
from pentimento.contracts.tables import read_table
from pentimento.copainting.synthesis.pairs import Image, as_batch
from pentimento.copainting.synthesis.score_filter import Threshold, min_score
from pentimento.semantics.encoder import Encoder

_SAMPLED = 512
"""Paintings, the first ones, whose scores with captions of others tell a threshold."""


def threshold_of(config: Threshold, encoder: Encoder, files: Sequence[Path]) -> float:
    """The least score a pair needs, for shards of the ``copaintings`` contract.

    Raises:
        ContractError: there is no painting at all.
    """
    pictures: list[Image] = []
    captions: list[str] = []
    for file in files:
        seen: set[str] = set()
        for row in read_table(file, CONTRACT).table.select(["scene_id", "full", "caption"]).to_pylist():
            if row["scene_id"] not in seen:
                seen.add(row["scene_id"])
                pictures.append(decode_png(row["full"]["bytes"]))
                captions.append(row["caption"])
        if len(pictures) >= _SAMPLED:
            break
    if not pictures:
        raise ContractError("No scene gave a painting; plan more strokes, or give each scene a target that has any.")
    return min_score(config, encoder, as_batch(pictures[:_SAMPLED]), captions[:_SAMPLED])


def keep_pairs(files: Sequence[Path], minimum: float, out: Path) -> dict[str, Any]:
    """Write the pairs that score ``minimum`` or more, shard by shard into an existing folder; return counts and means.

    A shard of which nothing is kept is not written. ``mse_of_copying`` is what a goal planner that returns its input
    would be wrong by: mean squared difference of the partial and the full painting, sRGB in [0, 1].

    Raises:
        ContractError: no pair is kept.
    """
    scores: list[float] = []
    paintings, kept_paintings = set[str](), set[str]()
    splits: Counter[str] = Counter()
    stay: dict[str, list[float]] = {strategy: [] for strategy in STRATEGIES}
    copying: dict[str, list[float]] = {strategy: [] for strategy in STRATEGIES}
    for file in files:
        table = read_table(file, CONTRACT).table
        good = table.filter(pc.greater_equal(table["clip_score"], pa.scalar(minimum, pa.float32())))
        scores += table["clip_score"].to_pylist()
        paintings |= _planned(table)
        kept_paintings |= _planned(good)
        splits.update(good["split"].to_pylist())
        for row in good.select(["strategy", "kept", "partial", "full"]).to_pylist():
            before, after = (decode_png(row[name]["bytes"]).astype(np.float64) / 255 for name in ("partial", "full"))
            stay[row["strategy"]].append(float(np.mean(row["kept"])))
            copying[row["strategy"]].append(float(np.square(after - before).mean()))
        if good.num_rows:
            pq.write_table(good, out / file.name, compression="zstd")
    pairs = sum(len(shares) for shares in stay.values())
    if not pairs:
        raise ContractError(
            f"No painting scores {minimum:.3g} with its caption or more (best of {len(scores)}: {max(scores):.3g}); "
            "lower synthesize_copaintings.threshold."
        )
    return {
        "paintings": len(paintings),
        "pairs": pairs,
        "kept_share": {"pairs": pairs / len(scores), "paintings": len(kept_paintings) / len(paintings)},
        "threshold": minimum,
        "clip_score": {"mean": float(np.mean(scores)), "median": float(np.median(scores))},
        "split": {split: splits[split] for split in SPLITS},
        "strategies": {
            strategy: {
                "pairs": len(stay[strategy]),
                "strokes_kept": float(np.mean(stay[strategy])),
                "mse_of_copying": float(np.mean(copying[strategy])),
            }
            for strategy in STRATEGIES
            if stay[strategy]
        },
    }


def _planned(table: pa.Table) -> set[str]:
    """The plans that were made; pairs of one thing beside another are of two of them."""
    return set(table.filter(pc.not_equal(table["strategy"], pa.scalar("beside")))["plan_id"].to_pylist())
