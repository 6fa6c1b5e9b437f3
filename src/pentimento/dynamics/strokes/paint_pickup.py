"""Paint pickup of recorded strokes, estimated from their photographs.

A brush that crosses wet paint picks some of it up and lays it down in all later strokes, also on blank paper, until it
is loaded again. A stroke's own photographs do not show the pickup: it is inherited from the strokes before.
``contracts.covariates`` computes the same for planned strokes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import grid_sample

from pentimento.contracts.covariates import PICKUP_COLUMNS, pickup_step
from pentimento.dynamics.strokes.photometry import srgb_to_linear
from pentimento.dynamics.strokes.samples import StrokeSamples

Array = NDArray[Any]

_PAPER = 0.9
"""Quantile of a window's brightness that is paper."""
_MIN_COVER = 0.3
"""Min coverage that counts as paint; less is an edge, or noise."""


def paint_pickup(table: pa.Table, samples: StrokeSamples) -> dict[str, Array]:
    """The pickup columns of strokes (``PICKUP_COLUMNS``), float64[B] each; {} where no age of wet paint is recorded.

    Strokes of one load have the same session and ``reload_id``. Where loads are not recorded, each stroke starts with a
    clean tool. Strokes that are missing from the table do not count.
    """
    if "wet_age_s" not in table.schema.names:
        return {}
    age_s = np.array([np.nan if v is None else v for v in table["wet_age_s"].to_pylist()])
    recorded = "reload_id" in table.schema.names
    loads = table["reload_id"].to_pylist() if recorded else [None] * len(age_s)
    sessions, order = table["session"].to_pylist(), np.array(table["order"].to_pylist())
    paints = np.unique(srgb_to_linear(samples.color).double().numpy().round(3), axis=0)
    share, crossed = _crossed(samples, paints)
    own = srgb_to_linear(samples.color).double().numpy()
    picked_up = np.empty((len(order), len(PICKUP_COLUMNS)))
    state, held = np.zeros(4), None
    for row in np.lexsort((order, np.unique(sessions, return_inverse=True)[1])):
        load = (sessions[row], loads[row] if loads[row] is not None else f"row {row}")
        if load != held:
            state, held = np.zeros(4), load
        picked_up[row], state = pickup_step(state, float(share[row]), crossed[row], float(age_s[row]), own[row])
    return dict(zip(PICKUP_COLUMNS, picked_up.T, strict=True))


def _crossed(samples: StrokeSamples, paints: Array) -> tuple[Array, Array]:
    """For each commanded path: the share of it over paint [B], and that paint's mean colour, linear light [B, 3].

    The paint at a point is the one of the session's paints whose mixtures with the paper come nearest to the pixel.
    """
    below = _along(samples)  # [B, N, 3]
    paper = samples.before_linear.flatten(1, 2).quantile(_PAPER, dim=1).double().numpy()[:, None]
    towards = paints - paper[:, :, None]  # [B, 1, K, 3]
    cover = ((below - paper)[:, :, None] * towards).sum(-1) / np.maximum(np.square(towards).sum(-1), 1e-6)
    cover = np.clip(cover, 0.0, 1.0)
    off = np.square((below - paper)[:, :, None] - cover[..., None] * towards).sum(-1)
    nearest = off.argmin(-1)  # [B, N]
    covered = np.take_along_axis(cover, nearest[..., None], -1)[..., 0]
    covered = np.where(covered > _MIN_COVER, covered, 0.0)
    weight = covered.sum(1)
    mean = (covered[..., None] * paints[nearest]).sum(1) / np.maximum(weight, 1e-9)[:, None]
    return covered.mean(1), mean


def _along(samples: StrokeSamples) -> Array:
    """Colour below the points of each path, linear light [B, N, 3]; outside the window that of its border."""
    height, width = samples.before_linear.shape[1:3]
    pixels: Tensor = samples.view.to_pixels(samples.path[..., 1:3])
    scaled = 2 * (pixels + 0.5) / torch.tensor([width, height], dtype=pixels.dtype) - 1
    seen = grid_sample(
        samples.before_linear.permute(0, 3, 1, 2), scaled[:, None].to(samples.before_linear.dtype),
        padding_mode="border", align_corners=False,
    )  # fmt: skip
    return seen[:, :, 0].permute(0, 2, 1).double().numpy()
