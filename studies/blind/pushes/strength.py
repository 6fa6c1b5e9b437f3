"""The energy q of an effect on pushes, and the strength that gives a wanted q.

As for strokes (`studies/blind/strokes/strength.py`), q is the energy of an effect that the base model cannot absorb,
over the noise floor. It is measured in pairs: each push with and without the effect, on the same surface and with the
same random numbers, in two realisations. (On the same surface, because the diagnosis sees in `before` what earlier
pushes left.) With C the change of height,

    D = C' - C,   R = D less its least-squares projection on the derivatives of the base,
    q = sum R_1 R_2 / (sum N^2 / 2),

where N is the difference of C between the two realisations without effects, over pushes into freshly smoothed material,
in windows around the pushes. The derivatives are those of the base fitted to the pushes without the effect.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.jacobian import derivatives
from pentimento.diagnosis.pushes.measured import PIXELS_PER_M, cropped
from pentimento.diagnosis.pushes.measured import measure as measure_pushes
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from pentimento.planning.pushes.analytic.model import first_model
from studies.blind.pushes.collect import as_table, rows_with_and_without
from studies.blind.pushes.worlds import Sketch
from studies.blind.truth import Strength, StrengthError

PUSHES = 36  # of a trial
SEEDS = (1_000_001, 1_000_002)  # offsets from the world's seed, with which the table is recorded
STRONGEST = 3.0  # max strength that is tried
USUAL = 0.3  # strength that typically gives q = 0.2
TOLERANCE = 0.2  # relative, of q
EVALUATIONS = 4  # max number of strengths tried

Array = NDArray[Any]


class Trial(NamedTuple):
    """A part of a world's design, executed without effects in both realisations."""

    sketch: Sketch
    quiet: tuple[PushSamples, PushSamples]


def prepare_trial(sketch: Sketch) -> Trial:
    """Execute the pushes without any effect."""
    (one, _), (two, _) = (_made(sketch, {}, seed) for seed in SEEDS)
    return Trial(sketch, (one, two))


def measure(trial: Trial, effect: str, strength: float) -> Strength:
    """q of one effect alone at a strength, and its standard error over the pushes."""
    rests = []
    for seed in SEEDS:
        with_effect, quiet = _made(trial.sketch, {effect: strength}, seed)
        known = quiet.known & with_effect.known
        difference = np.where(known, _change(with_effect) - _change(quiet), 0.0)
        rests.append(rest_of(difference, absorbed(quiet) * known))
    first, second = trial.quiet
    fresh = first.covariates["pushes_since_reset"] == 0
    noise = np.where(first.known & second.known, _change(first) - _change(second), 0.0)[fresh]
    floor = 0.5 * float(np.square(noise).mean())
    energy = (rests[0] * rests[1]).mean((1, 2)) / floor
    return Strength(strength, float(energy.mean()), float(energy.std() / np.sqrt(len(energy))))


def find_strength(trial: Trial, effect: str, q: float) -> Strength:
    """The strength at which the effect has about the wanted q.

    Raises StrengthError where no tried strength comes near.
    """
    tried = [measure(trial, effect, USUAL * float(np.sqrt(q / 0.2)))]
    while len(tried) < EVALUATIONS and abs(tried[-1].q / q - 1) > TOLERANCE:
        near = min(tried, key=lambda t: abs(np.log(max(t.q, 1e-4) / q)))
        guess = min(near.strength * float(np.clip((q / max(near.q, 0.02 * q)) ** 0.6, 0.2, 5.0)), STRONGEST)
        if any(abs(guess / t.strength - 1) < 0.02 for t in tried):
            break
        tried.append(measure(trial, effect, guess))
    best = min(tried, key=lambda t: abs(np.log(max(t.q, 1e-6) / q)))
    if not 0.5 < best.q / q < 2.0:
        raise StrengthError(
            f"No strength of {effect} was found that gives q = {q} with the {trial.sketch.tool.name}: tried "
            f"{[(round(t.strength, 3), round(t.q, 3)) for t in tried]}; hide it in another world."
        )
    return best


def _made(sketch: Sketch, strengths: dict[str, float], seed: int) -> tuple[PushSamples, PushSamples]:
    """Samples with the effects, and each push without them."""
    config = replace(sketch.config, pushes=PUSHES, repeated=0, times=1)
    both = rows_with_and_without(sketch, sketch.with_strengths(strengths), sketch.seed + seed, config)
    with_effects, quiet = (cropped(load_pushes(as_table(rows, {}), PIXELS_PER_M)[0]) for rows in both)
    return with_effects, quiet


def _change(samples: PushSamples) -> Array:
    """Millimetres, [N, H, W]."""
    return (samples.after.astype(np.float64) - samples.before) * 1e3


def absorbed(quiet: PushSamples) -> Array:
    """Derivatives of the base, fitted to pushes without the effect, by its parameters [P, N, H, W]."""
    measured = measure_pushes(quiet)
    base = fit(first_model(measured.scene), measured)
    return derivatives(base, measured.scene).astype(np.float64)


def rest_of(difference: Array, modes: Array) -> Array:
    """The residual of a difference [N, H, W] after least squares on the derivatives [P, N, H, W]."""
    flat = modes.reshape(len(modes), -1)
    weights = np.linalg.lstsq(flat @ flat.T, flat @ difference.ravel(), rcond=1e-9)[0]
    return np.asarray(difference - (weights @ flat).reshape(difference.shape))
