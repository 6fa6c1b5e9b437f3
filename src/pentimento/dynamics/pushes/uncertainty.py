"""How uncertain a push model is: intervals of each pixel's change of height, and what it leaves of a push.

The residual of a pixel is taken as normal with the variance

    spread² · s  +  noise  +  c · change²  +  e · |∇change|²,

where spread² is the variance of the ensemble's members and change the members' mean. The other terms are what no member
knows (the aleatoric part): noise of both scans, dents of another depth, and displaced edges (e is a squared distance).
The factors are fitted by maximum likelihood to pushes that the networks were not trained on, and residuals have longer
tails than normal ones: the width of the interval is the quantile of those residuals (conformal prediction, Vovk et al.
2005), so that it covers its share of pushes that are like them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls
from torch import Tensor

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.pose import PoseSamples, gradient, inner
from pentimento.dynamics.pushes.push_model import PushModel
from pentimento.planning.pushes.rollout import Unexplained

Array = NDArray[np.float64]

MOVED_MM = 0.2
"""Material moves where at least this change, up or down, is predicted or seen."""
_STILL_MM = 0.02
"""Where it predicts less than this, all that is seen is noise of the scans."""
_SCORINGS = 12
"""Steps of Fisher scoring."""
_MIN_VARIANCE_MM2 = 1e-6
"""A thousandth of a millimetre, squared."""


class Pixels(NamedTuple):
    """Known pixels of the crops of pushes, [P] each."""

    residual_mm: Array
    """Measured minus predicted change."""
    spread_mm2: Array
    """Variance of the members' predictions."""
    change_mm: Array
    """Predicted, the members' mean."""
    slope2: Array
    """Squared gradient of the same."""

    @property
    def expected(self) -> NDArray[np.bool_]:
        """[P]: which of them the model expects to move."""
        return np.abs(self.change_mm) >= MOVED_MM

    @property
    def seen(self) -> NDArray[np.bool_]:
        """[P]: which of them moved."""
        return np.abs(self.change_mm + self.residual_mm) >= MOVED_MM

    @property
    def moved(self) -> NDArray[np.bool_]:
        """[P]: which of them were expected or seen to move."""
        return self.expected | self.seen

    def pick(self, index: NDArray[np.bool_]) -> Pixels:
        """Those where ``index`` [P] is true."""
        return Pixels(*(field[index] for field in self))


@dataclass(frozen=True)
class Intervals:
    """Factors of the variance of a residual, and the width of an interval."""

    spread: float
    noise_mm2: float
    change: float
    edge_mm2: float
    coverage: float
    """Share of the residuals that the interval is to contain."""
    deviations: float
    """Half of the interval's width, in standard deviations."""

    def half_width_mm(self, pixels: Pixels) -> Array:
        """Half of the width [P] of each pixel's interval, around the members' mean."""
        factors = np.array([self.spread, self.noise_mm2, self.change, self.edge_mm2])
        variance = np.maximum(_terms(pixels) @ factors, _MIN_VARIANCE_MM2)
        return np.asarray(self.deviations * np.sqrt(variance))

    def covered(self, pixels: Pixels) -> float:
        """Share of the residuals that the intervals contain."""
        return float((np.abs(pixels.residual_mm) <= self.half_width_mm(pixels)).mean())


def pixels_of(model: PushModel, samples: PoseSamples) -> Pixels:
    """Residuals and what they depend on, of the known pixels that have a gradient."""
    each, mean = _predicted_mm(model, samples)
    known = inner(samples.known).numpy()
    slope2 = (1e-3 * model.facts.crop.pixels_per_m * gradient(mean)).square().sum(1)
    fields = (1e3 * samples.change - mean, each.var(0, unbiased=False), mean, slope2)
    return Pixels(*(field.numpy()[known].astype(np.float64) for field in fields))


def fit_intervals(pixels: Pixels, coverage: float = 0.9) -> Intervals:
    """Intervals that contain a share ``coverage`` of the residuals where the material moves.

    Args:
        pixels: of pushes that the networks were not trained on.

    Raises:
        ContractError: the material moves nowhere.
    """
    if not pixels.moved.any():
        raise ContractError(
            f"The held-out pushes change no height by {MOVED_MM:g} mm or more, so that the uncertainty of the push "
            "model cannot be fitted: hold out more pushes (train_push_dynamics.held_out)."
        )
    terms, squares = _terms(pixels), pixels.residual_mm**2
    variance = np.full(len(squares), max(float(squares.mean()), _MIN_VARIANCE_MM2))
    for _ in range(_SCORINGS):
        factors, _ = nnls(terms / variance[:, None], squares / variance)
        variance = np.maximum(terms @ factors, _MIN_VARIANCE_MM2)
    moved = pixels.moved
    deviations = float(np.quantile(np.abs(pixels.residual_mm[moved]) / np.sqrt(variance[moved]), coverage))
    spread, noise_mm2, change, edge_mm2 = (float(factor) for factor in factors)
    return Intervals(spread, noise_mm2, change, edge_mm2, coverage, deviations)


def fit_unexplained(model: PushModel, samples: PoseSamples) -> Unexplained:
    """The shares of pushes' energies, in height and slope, that the model leaves; without the noise of the scans.

    Args:
        samples: pushes that the networks were not trained on.
    """
    _, mean = _predicted_mm(model, samples)
    residual = 1e3 * samples.change - mean
    still = (mean.abs() < _STILL_MM) & inner(samples.known)
    return Unexplained(
        _unexplained(residual.square(), mean.square(), samples.known, still),
        _unexplained(gradient(residual).square().sum(1), gradient(mean).square().sum(1), inner(samples.known), still),
    )


def _unexplained(residual2: Tensor, change2: Tensor, known: Tensor, still: Tensor) -> float:
    noise = float(residual2[still].mean()) if bool(still.any()) else 0.0
    energy = float(change2[known].sum())
    left = float(residual2[known].sum()) - noise * int(known.sum())
    return min(max(left / energy, 0.0), 1.0) if energy > 0 else 1.0


def _predicted_mm(model: PushModel, samples: PoseSamples) -> tuple[Tensor, Tensor]:
    """Changes [M, N, side, side] by each member, and their mean."""
    with torch.no_grad():
        each = 1e3 * model.change(samples.state, samples.length_m, samples.depth_m, samples.context)
    return each, each.mean(0)


def _terms(pixels: Pixels) -> Array:
    """[P, 4]: what the factors of the variance are multiplied with."""
    return np.stack(
        [pixels.spread_mm2, np.ones_like(pixels.change_mm), pixels.change_mm**2, pixels.slope2], axis=1
    )  # fmt: skip
