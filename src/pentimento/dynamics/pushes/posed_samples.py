"""Measured pushes in the constant pose, as a network is trained and scored on them (thesis 7.3.4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.pose import Crop, to_pose, within

_SEEN = 0.99
"""Of the weights by which a pixel of the crop was sampled: so much must have been measured."""


class PoseSamples(NamedTuple):
    """N pushes in the constant pose, heights in metres."""

    state: Tensor  # [N, side, side] before
    change: Tensor  # [N, side, side] after - before
    known: Tensor  # [N, side, side] bool
    length_m: Tensor  # [N]
    depth_m: Tensor  # [N]
    context: Tensor  # [N] int64

    def pick(self, index: Tensor) -> PoseSamples:
        """The samples with these indices."""
        return PoseSamples(*(field[index] for field in self))

    def mirrored(self, mirror: Tensor) -> PoseSamples:
        """The same pushes seen in a mirror that holds the line of travel, where ``mirror`` [N] is true."""
        images = [torch.where(mirror[:, None, None], image.flip(1), image) for image in self[:3]]
        return PoseSamples(images[0], images[1], images[2], *self[3:])


def in_pose(samples: PushSamples, crop: Crop, context: int = 0) -> PoseSamples:
    """Measured pushes in the constant pose, all of one context."""
    window, action = (torch.from_numpy(array.astype(np.float32)) for array in (samples.window_m, samples.action))
    before, after, known = (
        to_pose(torch.from_numpy(image.astype(np.float32)), window, action, crop)
        for image in (samples.before, samples.after, samples.known)
    )
    inside = within(window, action, crop)
    return PoseSamples(
        before,
        after - before,
        (known > _SEEN) & inside,
        action[:, 3],
        action[:, 4],
        torch.full((len(action),), context),
    )
