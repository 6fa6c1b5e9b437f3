"""The card of a dataset of co-paintings: what it holds, how it was made, what was left out, whose pictures it is of."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pyarrow as pa

from pentimento.contracts.copaintings import CONTRACT, SPLITS
from pentimento.contracts.schema import columns_markdown
from pentimento.copainting.synthesis.pairs import Setting
from pentimento.copainting.synthesis.score_filter import Threshold


def dataset_card(
    name: str,
    setting: Setting,
    threshold: Threshold,
    metrics: dict[str, Any],
    scenes: pa.Table,
    scorer: str,
) -> str:
    """Markdown; ``metrics`` are those of ``keep_pairs``, ``scenes`` the rows that were painted."""
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
        "paintings with captions of others"
    )
    return f"""# Co-paintings: {name}

{metrics["pairs"]} pairs of a partial and a full painting of {metrics["paintings"]} captioned scenes, for learning to go
on with a painting that someone has begun.

## How they were made

Each scene was planned with up to {setting.strokes} strokes of the {setting.tool} on a blank sheet of
{setting.canvas_m[0] * 1e3:g} x {setting.canvas_m[1] * 1e3:g} mm, through the stroke model that the robot's own strokes
were diagnosed with; the pictures are what that model foretells, not photographs. Partial paintings are the same plans
with strokes removed; or (`beside`) two plans, each of one thing in its half of the sheet, of which the first is there
already and the second is asked for.

| missing | pairs | share of strokes that stay | mean squared difference to the full one |
|---|---|---|---|
{strategies}

Kept were pairs whose full painting has a CLIPScore with its caption (raw cosine, encoder
`{scorer[:12]}`) of at least {rule}: {metrics["kept_share"]["pairs"]:.1%} of the pairs,
{metrics["kept_share"]["paintings"]:.1%} of the paintings.

Pairs by split: {", ".join(f"{split} {metrics['split'][split]}" for split in SPLITS)}; splits go by scene.

## Sources and licences

{sources}

## Columns

{columns_markdown(CONTRACT)}"""
