"""New strokes of a hand: latents between those of few strokes, with what the decoder leaves unsaid.

A decoder gives the mean of the strokes that a latent stands for; people's strokes scatter about it. What the mean of a
stroke leaves out, such as a tremor, is laid on the strokes that are drawn near it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pentimento.demonstrations.standard import standardise
from pentimento.stroke_hands.hand_files import hand_of
from pentimento.stroke_hands.trajvae import Strokes, TrajVAE

FloatArray = NDArray[np.float64]

_KERNEL = 0.4
"""Width of the kernel, as a share of the standard deviation of the few strokes' latents."""


def sampled_strokes(model: TrajVAE, few: Strokes, count: int, rng: np.random.Generator) -> FloatArray:
    """Strokes [count, N, 2], metres, in the standard frame, like the few.

    Latents are those of one of the few, drawn towards their mean and spread by as much as that takes away: a kernel
    estimate of their density with their mean and covariance (Silverman 1986, 6.4).
    """
    hand = hand_of(model, few, "")
    known, latent = few.xy_m.double().numpy(), hand.latent_mean
    k = rng.integers(len(latent), size=count)
    apart = latent - latent.mean(0)
    kernel = rng.standard_normal((count, len(latent))) @ apart / np.sqrt(max(len(latent) - 1, 1))
    open_to = hand.latent_deviation[k] * rng.standard_normal((count, latent.shape[1]))
    drawn_at = latent.mean(0) + np.sqrt(1 - _KERNEL**2) * apart[k] + _KERNEL * kernel + open_to
    drawn = hand.decode(drawn_at.astype(np.float32))[0].astype(np.float64)
    left_out = known - hand.decode(latent)[0].astype(np.float64)
    larger = _sizes(drawn) / _sizes(known[k])
    return in_standard_frame(drawn + larger[:, None, None] * left_out[k])


def in_standard_frame(paths_m: FloatArray) -> FloatArray:
    """Paths [S, N, 2] as demonstrations are: from the origin to the x axis, at equal steps."""
    unknown = np.full((len(paths_m), paths_m.shape[1], 2), np.nan)
    points = np.concatenate([unknown[..., :1], paths_m, unknown], axis=-1)
    return np.stack([standardise(each, paths_m.shape[1])[0][:, 1:3] for each in points])


def _sizes(paths_m: FloatArray) -> FloatArray:
    """[S] root mean square distance of points from their middle."""
    return np.asarray(np.sqrt(np.square(paths_m - paths_m.mean(1, keepdims=True)).sum(-1).mean(-1)))
