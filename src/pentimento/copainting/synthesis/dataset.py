"""From shards of pairs to a dataset: the CLIPScore filter, its metrics, the data card and a preview picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from torch import Tensor

from pentimento.contracts.copaintings import CONTRACT, SPLITS, STRATEGIES
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.schema import columns_markdown
from pentimento.contracts.tables import read_table
from pentimento.copainting.synthesis.painter import Image, Setting
from pentimento.semantics.encoder import Encoder, as_images
from pentimento.semantics.scores import mismatched_quantile

_SAMPLED: Final = 512  # paintings, the first ones, whose scores with other captions give a threshold
_CELL_PX: Final = 96
_FRAME_PX: Final = 2
_COLUMNS: Final = {"all": 1, "random": 2, "salient": 2, "semantic": 2}  # partial paintings shown, by strategy
_EMPTY: Final = 190  # grey of a cell without a painting


@dataclass(frozen=True)
class Threshold:
    """The minimum CLIPScore of a painting: a number, or a quantile of the scores with captions of other scenes (thesis
    6.4.1).
    """

    score: float | None
    """A cosine, for a published encoder. The thesis's CLIPScore of .5 is a cosine of .2 (times 2.5; Hessel et al.
    2021).
    """
    mismatched_quantile: float | None
    """For any encoder: with .95, one painting in 20 would pass with the caption of another scene."""
    seed: int
    """Of the choice of other captions, if there are many."""

    def __post_init__(self) -> None:
        at_least(self, 0, "seed")
        if (self.score is None) == (self.mismatched_quantile is None):
            raise ValueError(
                f"score is {self.score} and mismatched_quantile {self.mismatched_quantile}; give one of them, the "
                "other null."
            )
        if self.mismatched_quantile is not None and not 0 <= self.mismatched_quantile <= 1:
            raise ValueError(f"mismatched_quantile is {self.mismatched_quantile}; it runs from 0 to 1.")


def min_score(config: Threshold, encoder: Encoder, pictures: Tensor, captions: Sequence[str]) -> float:
    """The threshold as a number, for full paintings [B, 3, H, W] (sRGB in [0, 1]) with their captions.

    Raises:
        ConfigError: a quantile is asked for, but all captions are the same.
    """
    if config.score is not None:
        return config.score
    assert config.mismatched_quantile is not None  # __post_init__ saw to it
    try:
        return mismatched_quantile(encoder, pictures, captions, q=config.mismatched_quantile, seed=config.seed)
    except ValueError as error:
        raise ConfigError(f"{error} Set threshold.score, or paint scenes with other captions.") from None


def threshold_of(config: Threshold, encoder: Encoder, files: Sequence[Path]) -> float:
    """The minimum score of a pair, for shards of the `copaintings` contract.

    Raises:
        ContractError: there is no painting.
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
    return min_score(config, encoder, as_images(pictures[:_SAMPLED]), captions[:_SAMPLED])


def keep_pairs(files: Sequence[Path], minimum: float, out: Path) -> dict[str, Any]:
    """Write the pairs that score at least `minimum`, shard by shard, into an existing folder; return counts and means.

    A shard without such a pair is not written. `mse_of_copying` is the error of a goal planner that returns its input:
    the mean squared difference of the partial and the full painting, sRGB in [0, 1].

    Raises:
        ContractError: no pair is kept.
    """
    scores: list[float] = []
    plans, kept_plans = set[str](), set[str]()
    splits: Counter[str] = Counter()
    kept: dict[str, list[float]] = {strategy: [] for strategy in STRATEGIES}
    copying: dict[str, list[float]] = {strategy: [] for strategy in STRATEGIES}
    for file in files:
        table = read_table(file, CONTRACT).table
        good = table.filter(pc.greater_equal(table["clip_score"], pa.scalar(minimum, pa.float32())))
        scores += table["clip_score"].to_pylist()
        plans |= _plan_ids(table)
        kept_plans |= _plan_ids(good)
        splits.update(good["split"].to_pylist())
        for row in good.select(["strategy", "kept", "partial", "full"]).to_pylist():
            before, after = (decode_png(row[name]["bytes"]).astype(np.float64) / 255 for name in ("partial", "full"))
            kept[row["strategy"]].append(float(np.mean(row["kept"])))
            copying[row["strategy"]].append(float(np.square(after - before).mean()))
        if good.num_rows:
            pq.write_table(good, out / file.name, compression="zstd")
    pairs = sum(len(shares) for shares in kept.values())
    if not pairs:
        raise ContractError(
            f"No painting scores {minimum:.3g} or more with its caption (best of {len(scores)}: {max(scores):.3g}); "
            "lower synthesize_copaintings.threshold."
        )
    return {
        "paintings": len(plans),
        "pairs": pairs,
        "kept_share": {"pairs": pairs / len(scores), "paintings": len(kept_plans) / len(plans)},
        "threshold": minimum,
        "clip_score": {"mean": float(np.mean(scores)), "median": float(np.median(scores))},
        "split": {split: splits[split] for split in SPLITS},
        "strategies": {
            strategy: {
                "pairs": len(kept[strategy]),
                "strokes_kept": float(np.mean(kept[strategy])),
                "mse_of_copying": float(np.mean(copying[strategy])),
            }
            for strategy in STRATEGIES
            if kept[strategy]
        },
    }


def _plan_ids(table: pa.Table) -> set[str]:
    """The plans of the pairs; those of `beside` pairs are combinations of two."""
    return set(table.filter(pc.not_equal(table["strategy"], pa.scalar("beside")))["plan_id"].to_pylist())


def dataset_card(
    name: str,
    setting: Setting,
    threshold: Threshold,
    *,
    metrics: dict[str, Any],
    scenes: pa.Table,
    scorer: str,
) -> str:
    """The data card in Markdown; `metrics` are those of `keep_pairs`, `scenes` the rows that were painted."""
    origins = Counter(zip(scenes["source"].to_pylist(), scenes["licence"].to_pylist(), strict=True))
    sources = "\n".join(f"- {count} scenes: {source}, {licence}" for (source, licence), count in origins.items())
    strategies = "\n".join(
        f"| {strategy} | {entry['pairs']} | {entry['strokes_kept']:.2f} | {entry['mse_of_copying']:.4f} |"
        for strategy, entry in metrics["strategies"].items()
    )
    rule = (
        f"{threshold.score}"
        if threshold.score is not None
        else f"{metrics['threshold']:.4f}, the quantile {threshold.mismatched_quantile} of the scores of "
        "paintings with captions of other scenes"
    )
    return f"""# Co-paintings: {name}

{metrics["pairs"]} pairs of a partial and a full painting of {metrics["paintings"]} captioned scenes, to train
a model that completes a started painting.

## Method

Each scene was planned with up to {setting.strokes} strokes of the {setting.tool} on a blank sheet of
{setting.canvas_m[0] * 1e3:g} x {setting.canvas_m[1] * 1e3:g} mm, with the stroke model that was diagnosed on the
robot's own strokes. The pictures are predictions of that model, not photographs. A partial painting is the same plan
with strokes removed. With the strategy `beside`, it is the plan of one thing in one half of the sheet, and the full
painting adds the plan of another thing in the other half.

| strategy | pairs | fraction of strokes kept | mean squared difference to the full painting |
|---|---|---|---|
{strategies}

A pair is kept if the CLIPScore of its full painting and its caption (raw cosine, encoder
`{scorer[:12]}`) is at least {rule}. This holds for {metrics["kept_share"]["pairs"]:.1%} of the pairs and
{metrics["kept_share"]["paintings"]:.1%} of the paintings.

Pairs by split: {", ".join(f"{split} {metrics['split'][split]}" for split in SPLITS)}.
All pairs of a scene are in one split.

## Sources and licences

{sources}

## Columns

{columns_markdown(CONTRACT)}"""


def preview(scenes: Sequence[Mapping[str, Any]], files: Sequence[Path]) -> Image:
    """A row for each scene: the scene, its full painting, and partial paintings of each strategy.

    Args:
        scenes: rows of the `scenes` contract.
        files: shards of the `copaintings` contract, before the filter.
    """
    wanted = {row["scene_id"]: row for row in scenes}
    found: dict[str, list[dict[str, Any]]] = {}
    for file in files:
        table = read_table(file, CONTRACT).table
        for row in table.filter(pc.is_in(table["scene_id"], pa.array(wanted))).to_pylist():
            found.setdefault(row["scene_id"], []).append(row)
        if len(found) == len(wanted):
            break
    return np.concatenate([_row(wanted[scene_id], rows) for scene_id, rows in found.items()])


def _row(scene: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> Image:
    cells = [_cell(scene["image"]), _cell(rows[0]["full"])]
    for strategy, number in _COLUMNS.items():
        shown = [_cell(row["partial"]) for row in rows if row["strategy"] == strategy][:number]
        cells += shown + [np.full_like(cells[0], _EMPTY)] * (number - len(shown))
    return np.concatenate(cells, axis=1)


def _cell(image: Mapping[str, Any]) -> Image:
    """The picture, scaled to fit, in a white square."""
    picture = decode_png(image["bytes"])
    scale = _CELL_PX / max(picture.shape[:2])
    height, width = (max(round(side * scale), 1) for side in picture.shape[:2])
    side = _CELL_PX + 2 * _FRAME_PX
    framed = np.full((side, side, 3), 255, np.uint8)
    top, left = (side - height) // 2, (side - width) // 2
    framed[top : top + height, left : left + width] = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return framed
