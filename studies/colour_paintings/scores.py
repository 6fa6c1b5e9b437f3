"""What a painting is scored by: pixels, features of the judge encoder, bare paper, and small salient colours."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import interpolate, normalize

from pentimento.contracts.colour import delta_e_2000, linear_to_srgb, srgb_to_lab, to_float
from pentimento.semantics.encoder import Encoder, as_images, normalise

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_SCALES = (1.0, 0.5)
"""Resolutions, as shares of the painting's (one pixel a millimetre), at which features are compared."""
_PAPER = 8.0
"""ΔE (CIEDE2000) up to which a pixel counts as bare paper, and beyond which the target is not meant to be paper."""
_EYE_PX = 1.0
"""Standard deviation of the blur, in millimetres, through which salient colours are compared: no brush is sharper."""
_NEAR_AB = 8.0
"""Radius in the plane of a* and b* within which colours count as the same."""
_RARE, _LEAST = 0.05, 0.003
"""Largest and smallest share of the sheet of a small salient colour."""
_SALIENT = 3
"""Most salient colours of a picture."""
_TIP_PX = 3
"""Side, in millimetres, of what the brush can paint: salient places are opened by it."""


@dataclass(frozen=True)
class Scores:
    """Of one painting."""

    mse: float
    """Mean squared difference in sRGB in [0, 1]."""
    features: float
    """See ``feature_distance``."""
    uncovered: float
    """Share of the sheet."""
    salient: tuple[float, ...]
    """Median ΔE (CIEDE2000) over the places of each salient colour of the target."""


def score(painting: Image, target: NDArray[np.float32], paper: Image, judge: Encoder) -> Scores:
    """Score the last photograph [H, W, 3] against the target (linear light) and a photograph of the blank sheet."""
    wanted = np.clip(linear_to_srgb(target.astype(np.float64)), 0.0, 1.0)
    painted = to_float(painting).astype(np.float64)
    found, aim, sheet = (srgb_to_lab(image) for image in (painted, wanted, to_float(paper).astype(np.float64)))
    bare = (delta_e_2000(found, sheet) < _PAPER) & (delta_e_2000(aim, sheet) > 2 * _PAPER)
    soft = delta_e_2000(srgb_to_lab(_soft(painted)), srgb_to_lab(_soft(wanted)))
    return Scores(
        float(np.square(painted - wanted).mean()),
        feature_distance(judge, painting, np.rint(wanted * 255).astype(np.uint8)),
        float(bare.mean()),
        tuple(float(np.median(soft[place])) for place in salient_places(wanted)),
    )


def feature_distance(judge: Encoder, one: Image, other: Image) -> float:
    """The distance of LPIPS (Zhang et al. 2018) without its learned weights, on the judge's convolutions.

    After each convolution the features of a place are scaled to unit length; squared differences are summed over
    channels and averaged over places, layers and the two resolutions of ``_SCALES``.
    """
    pair, distances = as_images([one, other]), []
    with torch.no_grad():
        for scale in _SCALES:
            size = [round(scale * length) for length in pair.shape[-2:]]
            states = normalise(interpolate(pair, size, mode="bilinear", antialias=True, align_corners=False))
            for layer in judge.model.vision_model.embeddings.stem:
                states = layer(states)
                first, second = normalize(states, dim=1, eps=1e-6)
                distances.append(float(torch.square(first - second).sum(0).mean()))
    return float(np.mean(distances))


def salient_places(wanted: FloatArray) -> list[Mask]:
    """Masks [H, W] of the target's small salient colours, the most salient first, at most ``_SALIENT``.

    A place is rare if less than ``_RARE`` of the sheet has its a* and b* within ``_NEAR_AB``. Rare places are grouped
    greedily around the one with the most rare places of its colour. A group is a salient colour if it keeps
    ``_LEAST`` to ``_RARE`` of the sheet when what is narrower than the brush is dropped. Salience is the root of the
    group's area times the distance of its colour from that of the sheet's other places, in the plane of a* and b*.

    Args:
        wanted: sRGB [H, W, 3].
    """
    lab = srgb_to_lab(_soft(wanted))
    ab = lab[..., 1:].reshape(-1, 2)
    cells, cell_of = np.unique(np.rint(ab / 2).astype(int), axis=0, return_inverse=True)
    cell_of, share = cell_of.ravel(), np.bincount(cell_of.ravel()) / len(ab)
    near = np.square(2 * (cells[:, None] - cells)).sum(-1) <= _NEAR_AB**2
    left = near @ share < _RARE
    found: list[tuple[float, Mask]] = []
    while left.any():
        mass = np.where(left, near @ (share * left), 0.0)
        middle = int(mass.argmax())
        if mass[middle] < _LEAST:
            break
        group = near[middle] & left
        left &= ~near[middle]
        place = _opened(group[cell_of].reshape(wanted.shape[:2]))
        if not _LEAST <= place.mean() <= _RARE:
            continue
        inside = place.ravel()
        away = float(np.linalg.norm(ab[inside].mean(0) - ab[~inside].mean(0)))
        found.append((np.sqrt(place.mean()) * away, place))
    return [place for _, place in sorted(found, key=lambda one: -one[0])[:_SALIENT]]


def _opened(mask: Mask) -> Mask:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_TIP_PX, _TIP_PX))
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc), dtype=bool)


def _soft(srgb: FloatArray) -> FloatArray:
    return np.clip(np.asarray(cv2.GaussianBlur(srgb, (0, 0), _EYE_PX), dtype=np.float64), 0.0, 1.0)
