"""Whether scenes that lose more when the robot paints them score worse (thesis 6.8.2)."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pentimento.contracts.images import decode_png
from pentimento.copainting.evaluation.measures import as_tensor, delta_pix, delta_sem
from pentimento.copainting.evaluation.scoring import correlations
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import clip_score


def painted_gap(pairs: pa.Table, scenes: pa.Table, main: Encoder) -> dict[str, dict[str, float]]:
    """How the gap between a scene and its full painting goes with the painting's score; empty where ids do not match.

    Args:
        pairs: a checked `copaintings` table.
        scenes: the checked `scenes` table that it was made of.
    """
    pictures = {row["scene_id"]: row["image"]["bytes"] for row in scenes.select(["scene_id", "image"]).to_pylist()}
    whole = pairs.filter(pc.is_null(pairs["region"]))  # others may ask for one thing of the scene only
    rows = {row["scene_id"]: row for row in whole.select(["scene_id", "full", "caption"]).to_pylist()}
    known = [row for name, row in sorted(rows.items()) if name in pictures]
    if not known:
        return {}
    painted = np.stack([decode_png(row["full"]["bytes"]) for row in known])
    shown = np.stack([decode_png(pictures[row["scene_id"]]) for row in known])
    scores = clip_score(main, as_tensor(painted), [row["caption"] for row in known]).double().numpy()
    return correlations(
        {"delta_pix": delta_pix(shown, painted), "delta_sem": delta_sem(main, shown, painted)}, scores
    )  # fmt: skip
