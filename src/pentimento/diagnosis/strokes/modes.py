"""What is left when no known cause explains more: modes of the residual against everything that was recorded.

A mode is a way in which a mark can differ as a whole: amplitude, width, shifts along and across its path and along the
canvas's axes, blur. Each row's residual is projected on each mode, and the projections, weighted as they scatter (in
a short or shallow mark a mode is hardly seen), are tested against covariates by permutation of strokes, max-T over all
pairs. What the strongest covariate does is taken out of all modes before the
next is looked for: what merely goes along with it (time with wear, temperature with both) is not named beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls

from pentimento.diagnosis.strokes.jacobian import linearise_rows
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.predict import Model
from pentimento.dynamics.strokes.mechanisms.bleeding import bleed
from pentimento.dynamics.strokes.mechanisms.geometry import tangent
from pentimento.dynamics.strokes.simulation import Mechanism, Quantity, StrokeContext
from pentimento.dynamics.strokes.traj2stroke import Mark

Array = NDArray[Any]

MODES = ("amplitude", "width", "tangential", "normal", "canvas_x", "canvas_y", "blur")
_DRAWS = 1999
_P = 0.01
_MAX = 6
_OUTLYING = 4
"""In usual deviations: beyond, a score counts as this much."""
_MIN_SEEN = 50.0
"""Times the usual variance: a mode that is seen less in a mark counts as this."""


class AllModes(Mechanism):
    """All of them at once, by an amount of each that is the same for all strokes."""

    cause: ClassVar[str] = "modes"
    site = "density"
    quantities = (
        Quantity("amplitude", "1", 0.2),
        Quantity("width", "1", 0.2),
        Quantity("tangential", "m", 0.0005),
        Quantity("normal", "m", 0.0005),
        Quantity("canvas_x", "m", 0.0005),
        Quantity("canvas_y", "m", 0.0005),
        Quantity("blur", "1", 0.4),
    )

    def mark(self, mark: Mark, context: StrokeContext) -> Mark:
        """See ``Mechanism``."""
        amplitude, width, tangential, normal, x, y, blur = self.values
        along = tangent(context.path)
        across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
        moved = mark._replace(
            points_m=mark.points_m + tangential * along + normal * across + torch.stack([x, y]),
            radius_m=mark.radius_m * torch.exp(width),
            density=mark.density * torch.exp(amplitude),
        )
        return bleed(moved, blur.expand_as(mark.radius_m), torch.zeros_like(mark.radius_m))


class Unexplained(NamedTuple):
    """A mode that still depends on a covariate."""

    mode: str
    covariate: str
    p: float
    generic_gain: float
    """Share of the error that a quadratic of the covariate in this mode would remove, to second order."""


def mode_scores(model: Model, measured: Measured) -> tuple[Array, Array, float]:
    """Each row's residual in each mode, in typical sizes, [B, M]; the modes' own energies [B, M]; and the mean error
    of the rows.
    """
    curvature, slope, error = linearise_rows(model.plus(AllModes(torch.zeros(len(MODES)), {})), measured)
    own = np.einsum("bmm->bm", curvature[:, -len(MODES) :, -len(MODES) :])
    return slope[:, -len(MODES) :] / np.maximum(own, 1e-12), own, float(error.mean())


def unexplained(
    model: Model, measured: Measured, columns: Mapping[str, Array], seed: int
) -> tuple[list[Unexplained], Array, list[str]]:
    """What is significant, and all statistics |t| [M, covariates] with the covariates' names, for the heat map.

    Args:
        columns: covariates, [B] each, without gaps.
    """
    return structure(MODES, *mode_scores(model, measured), columns, measured.action, seed)


def structure(
    modes: Sequence[str],
    scores: Array,
    energy: Array,
    error: float,
    columns: Mapping[str, Array],
    action: Array,
    seed: int,
) -> tuple[list[Unexplained], Array, list[str]]:
    """``unexplained`` for amounts of any modes.

    Args:
        modes: names, [M].
        scores: amount of each mode in each row's residual, in typical sizes, [B, M].
        energy: what one typical size of each is worth in the row's error, [B, M].
        error: mean over the rows.
        columns: what the modes may depend on, [B] each, without gaps.
        action: rows of one value repeat one command, [B].
        seed: of the permutations.
    """
    names = list(columns)
    if not names:
        return [], np.zeros((len(modes), 0)), []
    scores, weight, spread = levelled(scores, energy)
    root = np.sqrt(weight)
    lines = np.stack([_standard(c) for c in columns.values()])  # [C, B]
    basis = np.stack([lines, np.stack([_standard(line**2) for line in lines])])
    whole = _strength(scores, weight, basis)
    found: list[Unexplained] = []
    left = scores
    while len(found) < _MAX:
        observed = _strength(left, weight, basis)
        rng = np.random.default_rng([seed, 9, len(found)])
        orders = permuted_actions(action, _DRAWS, rng)
        largest = np.array([_strength(left[order], weight[order], basis).max() for order in orders])
        limit = np.quantile(largest, 1 - _P)
        c = int(np.argmax(observed.max(0)))
        standing = np.flatnonzero(observed[:, c] >= limit)
        if not len(standing):
            break
        # Neighbouring modes answer to one cause: the one by which it would explain most of the picture.
        gains = [_generic_gain(left[:, m] * spread[m], energy[:, m], basis[:, c].T) / error for m in standing]
        m = int(standing[int(np.argmax(gains))])
        p = float((1 + (largest >= observed[m, c]).sum()) / (_DRAWS + 1))
        found.append(Unexplained(modes[m], names[c], p, float(max(gains))))
        one = np.column_stack([np.ones(len(left)), basis[:, c].T])
        left = np.stack([left[:, m] - one @ _least_squares(one, left[:, m], root[:, m]) for m in range(len(modes))], 1)
    return found, np.sqrt(whole), names


def levelled(scores: Array, energy: Array) -> tuple[Array, Array, Array]:
    """Scores [B, M] about their median, in their usual deviation, outliers clipped; their weights [B, M], 1 on average;
    and the usual deviations [M].
    """
    scores = scores - np.median(scores, axis=0)
    spread = np.median(np.abs(scores), axis=0) * 1.4826 + 1e-12
    scores = scores / spread
    weight = _certainty(scores, energy)
    root = np.sqrt(weight)
    return np.clip(scores * root, -_OUTLYING, _OUTLYING) / root, weight, spread


def permuted_actions(action: Array, draws: int, rng: np.random.Generator) -> Array:
    """Row indices [draws, B] with whole actions exchanged for others of as many rows: repeats of one command are alike,
    and taken apart they would make what they share look surer than it is.
    """
    rows = [np.flatnonzero(action == number) for number in np.unique(action)]
    order = np.tile(np.arange(len(action)), (draws, 1))
    for size in sorted({len(own) for own in rows}):
        alike = np.stack([own for own in rows if len(own) == size])
        exchanged = rng.permuted(np.tile(np.arange(len(alike)), (draws, 1)), axis=1)
        order[:, alike] = alike[exchanged]
    return order


def _certainty(scores: Array, energy: Array) -> Array:
    """Weights of scores [B, M]: one over their variance, which is one for all, as actions differ, and one that falls
    with the mode's own energy, as the noise of pixels does; how much of each, their squares say.
    """
    weight = np.empty_like(scores)
    for m, (score, own) in enumerate(zip(scores.T, energy.T, strict=True)):
        by_pixels = np.minimum(np.median(own) / np.maximum(own, 1e-12), _MIN_SEEN)
        expected = 1 / (1 + by_pixels)  # squares scatter by themselves: what is larger says less
        shapes = np.stack([np.ones_like(by_pixels), by_pixels], axis=1)
        shares, _ = nnls(shapes * expected[:, None], np.clip(np.square(score), 0, _OUTLYING**2) * expected)
        weight[:, m] = 1 / np.maximum(shapes @ shares, 1e-6)
    return weight / weight.mean(0)


def _strength(scores: Array, weight: Array, basis: Array) -> Array:
    """How strongly each mode goes with each covariate, or with its square, chi-squared [M, C], by weighted correlation.

    Args:
        scores, weight: [B, M].
        basis: [2, C, B] each covariate, and its square.
    """
    total, weighed = weight.sum(0), weight * scores
    mean = weighed.sum(0) / total
    spread = (weighed * scores).sum(0) - total * mean**2  # [M]
    at, with_scores = np.split(basis @ np.hstack([weight, weighed]), 2, axis=-1)  # [2, C, M]
    own = np.square(basis) @ weight - at**2 / total
    strength: Array = np.square(with_scores - at * mean) / np.maximum(own * spread, 1e-12)
    return strength.max(0).T * len(scores)


def _least_squares(basis: Array, values: Array, root_weight: Array) -> Array:
    """Coefficients [K] of [B, K] for values [B] with these roots of weights."""
    found: Array = np.linalg.lstsq(basis * root_weight[:, None], values * root_weight, rcond=None)[0]
    return found


def _generic_gain(amount: Array, energy: Array, basis: Array) -> float:
    """Mean error that a quadratic of the covariate would remove, to second order."""
    fitted = basis @ _least_squares(basis, amount, np.sqrt(energy))
    return float((energy * (amount**2 - (amount - fitted) ** 2)).mean())


def _standard(values: Array) -> Array:
    centred = values - values.mean(0)
    result: Array = centred / np.maximum(centred.std(0), 1e-12)
    return result
