"""What the report shows beside the verdict: maps of residuals, modes, imitation, power; numbers only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from pentimento.diagnosis.score import project
from pentimento.diagnosis.strokes.aliasing import Aliasing, Columns, aliasing, columns_of, information, with_all
from pentimento.diagnosis.strokes.diagnose import Diagnosis
from pentimento.diagnosis.strokes.jacobian import Statistics, linearise
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.modes import MODES, mode_scores
from pentimento.diagnosis.strokes.path_covariates import covariates_shown
from pentimento.diagnosis.strokes.predict import Model, residual
from pentimento.dynamics.strokes.mechanisms import VOCABULARY

Array = NDArray[Any]

_FIRST_P = 0.02
_POWER = 0.8
_BINS = 7
_SHOWN = 6


class Dependence(NamedTuple):
    """How one mode of the residual goes with one covariate, in bins of equally many strokes."""

    mode: str
    covariate: str
    centre: Array
    """[K] of the covariate."""
    base: Array
    """[K, 2] mean of the mode's amount in typical sizes, and the half width of its 95 % band."""
    extended: Array


class Survey(NamedTuple):
    """All that is drawn."""

    measured: Measured
    test_split: Measured
    full: Model
    """The extended model with every other observable cause at no effect."""
    aliasing: Aliasing
    detectable: dict[str, float]
    """Smallest share of the error that a cause must remove to be found in four of five such collections."""
    base_strength: Array
    """[modes, covariates] of the base's residual, correlation times the root of the number of strokes."""
    extended_strength: Array
    covariates: tuple[str, ...]
    modes: tuple[str, ...]
    dependence: tuple[Dependence, ...]
    base_residual: Array
    """[B, H, W] of all strokes, measured less foretold, mean over the channels; NaN outside the windows."""
    extended_residual: Array


def survey(diagnosis: Diagnosis) -> Survey:
    """Look at base and extended model over all strokes."""
    measured = diagnosis.measured
    full = with_all(diagnosis.extended, measured, VOCABULARY)
    statistics = linearise(full, measured)
    columns = columns_of(full)
    covariates = covariates_shown(measured)
    amounts = {
        name: standing(mode_scores(model, measured)[0])
        for name, model in (("base", diagnosis.base), ("extended", diagnosis.extended))
    }
    strengths = {name: mode_strength(values, covariates) for name, values in amounts.items()}
    return Survey(
        measured=measured,
        test_split=measured.pick(diagnosis.splits.test),
        full=full,
        aliasing=aliasing(statistics, columns),
        detectable=detectable(statistics, columns),
        base_strength=strengths["base"],
        extended_strength=strengths["extended"],
        covariates=tuple(covariates),
        modes=MODES,
        dependence=dependences(MODES, amounts["base"], amounts["extended"], covariates, strengths, measured.action),
        base_residual=_signed(diagnosis.base, measured),
        extended_residual=_signed(diagnosis.extended, measured),
    )


def mode_strength(amounts: Array, covariates: dict[str, Array]) -> Array:
    """How strongly modes [B, M] go with covariates, linearly or by their square: sqrt(n) |r|, [M, C]."""
    if not covariates:
        return np.zeros((amounts.shape[1], 0))
    y = _standard(np.clip(amounts, -4, 4))
    found = []
    for values in covariates.values():
        line = _standard(values)
        found.append(np.abs(np.stack([line, _standard(line**2)]) @ y).max(0) / len(y))
    return np.stack(found, axis=1) * np.sqrt(len(y))


def detectable(statistics: Statistics, columns: Columns) -> dict[str, float]:
    """The smallest share of the error that each cause must remove to be found with a probability of 80 %.

    From the noncentral chi-squared law of its robust score test at the level of the first step, shared among all
    candidates (Bonferroni, so a little too careful). Infinite where the nuisances leave nothing of a cause.
    """
    level = _FIRST_P / max(len(columns.causes), 1)
    error, n = float(statistics.energy.mean()), len(statistics.energy)
    total = statistics.curvature.sum(0)
    found = {}
    for cause, index in columns.causes.items():
        degrees = len(index)
        threshold = float(chi2.isf(level, degrees))
        shift = float(brentq(lambda nc, d=degrees, t=threshold: ncx2.sf(t, d, nc) - _POWER, 1e-3, 1e4))
        scores = project(statistics, columns.nuisances, index)
        left = information(total, columns.nuisances, index)
        scale = np.sqrt(np.maximum(np.diag(left), 1e-300))
        spread = np.linalg.pinv(left / np.outer(scale, scale), rcond=1e-6, hermitian=True) @ (
            (scores / scale).T @ (scores / scale)
        )
        found[cause] = shift * float(np.trace(spread)) / degrees / n / max(error, 1e-300)
    return found


def _signed(model: Model, measured: Measured) -> Array:
    rest = residual(model, measured).mean(-1)
    return np.where(measured.samples.valid.numpy() > 0, rest, np.nan)


def standing(scores: Array) -> Array:
    """Modes about their medians, in robust deviations."""
    centred = scores - np.median(scores, axis=0)
    deviations: Array = centred / (np.median(np.abs(centred), axis=0) * 1.4826 + 1e-12)
    return deviations


def dependences(
    modes: Sequence[str],
    base: Array,
    extended: Array,
    covariates: dict[str, Array],
    strengths: dict[str, Array],
    action: Array,
) -> tuple[Dependence, ...]:
    """The strongest pairs of the base, and of what is left, each covariate at most twice."""
    names = list(covariates)
    scale = strengths["base"], strengths["extended"]
    ranked = sorted(
        ((float(max(s[m, c] for s in scale)), m, c) for m in range(base.shape[1]) for c in range(len(names))),
        reverse=True,
    )
    shown: list[Dependence] = []
    times: dict[int, int] = {}
    for _, m, c in ranked:
        if len(shown) == _SHOWN:
            break
        if times.get(c, 0) == 2:
            continue
        times[c] = times.get(c, 0) + 1
        values = covariates[names[c]]
        edges = np.unique(np.quantile(values, np.linspace(0, 1, _BINS + 1)))
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        used = [k for k in range(len(edges) - 1) if (place == k).any()]
        centre = np.array([values[place == k].mean() for k in used])
        of_base, of_extended = (
            np.array([_mean_and_band(np.clip(amount[place == k, m], -6, 6), action[place == k]) for k in used])
            for amount in (base, extended)
        )
        shown.append(Dependence(modes[m], names[c], centre, of_base, of_extended))
    return tuple(shown)


def _mean_and_band(values: Array, action: Array) -> tuple[float, float]:
    """Mean over actions and 1.96 of its standard errors; NaN where a single action says nothing of a spread."""
    _, group, count = np.unique(action, return_inverse=True, return_counts=True)
    means = np.bincount(group, values) / count
    band = 1.96 * means.std(ddof=1) / np.sqrt(len(means)) if len(means) > 1 else np.nan
    return float(means.mean()), float(band)


def _standard(values: Array) -> Array:
    centred = values - values.mean(0)
    result: Array = centred / np.maximum(centred.std(0), 1e-12)
    return result
