"""Whether what a diagnosis established helps a network that is planned with, on pushes that neither has seen."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.pushes.diagnose import PushDiagnosis
from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.measured import PIXELS_PER_M, MeasuredPushes, cropped
from pentimento.dynamics.pushes.analytic_correction import Correction, split_hidden
from pentimento.dynamics.pushes.measured import PushSamples

Array = NDArray[Any]


class CrossFitted(NamedTuple):
    """What came of it. Errors are mean squared, mm², over windows about the pushes."""

    correction: Correction | None
    """None where it does not help, or no established cause is hidden from a network."""
    causes: tuple[str, ...]
    """That were tried."""
    deciding: tuple[float, float] | None
    """Of the network alone and corrected, on the half of the held-out actions that decides."""
    held_out: tuple[float, float]
    """The same on the other half: alone, and as it is planned with."""


def cross_fit(
    diagnosis: PushDiagnosis, samples: PushSamples, predicted: Array, held_out: Array, seed: int
) -> CrossFitted:
    """Fit the established causes to what the network was trained on, and try them on what it was not.

    Args:
        diagnosis: of the same rows.
        samples: whole scans, on the diagnosis's pixels.
        predicted: what the network foretells of each [N, H, W], metres, likewise (``averaged``).
        held_out: numbers of the actions that the network has not seen.
        seed: of the halves.
    """
    measured = diagnosis.measured
    unseen = np.isin(measured.action, held_out)
    decides = np.random.default_rng([seed, 16]).permutation(held_out)[: len(held_out) // 2]
    deciding = np.isin(measured.action, decides)
    said = cropped(samples._replace(after=predicted.astype(np.float32))).after
    alone = _missed(said, measured)
    trained = measured.pick(np.flatnonzero(~unseen))
    models = split_hidden(diagnosis.extended, lambda model: fit(model, trained))
    rest = unseen & ~deciding
    if models is None:
        return CrossFitted(None, (), None, (float(alone[rest].mean()),) * 2)
    usual = {name: float(np.nanmean(v)) for name, v in measured.scene.covariates.items() if np.isfinite(v).any()}
    correction = Correction(*models, measured.scene.half_width_m, usual)
    with_it = _missed(said + correction.of(measured.scene), measured)
    errors = float(alone[deciding].mean()), float(with_it[deciding].mean())
    kept = errors[1] < errors[0]
    causes = tuple(m.cause for m in models[0].mechanisms if m.cause not in {one.cause for one in models[1].mechanisms})
    planned = with_it if kept else alone
    return CrossFitted(
        correction if kept else None, causes, errors, (float(alone[rest].mean()), float(planned[rest].mean()))
    )


def averaged(height_m: Array, pixels_per_m: float) -> Array:
    """Heights [N, H, W] on the pixels of a diagnosis, means over blocks as ``load_pushes`` takes them."""
    factor = max(round(pixels_per_m / PIXELS_PER_M), 1)
    rows, columns = (side // factor for side in height_m.shape[1:])
    blocks = height_m[:, : rows * factor, : columns * factor].reshape(-1, rows, factor, columns, factor)
    return np.asarray(blocks.mean(axis=(2, 4)))


def _missed(said: Array, measured: MeasuredPushes) -> Array:
    """Of each row, mm² [B]."""
    missed = np.where(measured.valid, (measured.samples.after - said) * 1e3, 0.0)
    return np.asarray(np.square(missed).sum((1, 2)) / measured.valid.sum((1, 2)))
