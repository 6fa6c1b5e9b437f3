"""How strong an effect on pushes is, and the strength that gives a wanted one.

As for strokes (`studies/blind/strength.py`), q is the energy of an effect that the finder's base cannot absorb, over
the noise floor, measured in pairs: each push with and without the effect, on the same surface and under the same random
numbers, in two worlds that differ in all that differs between repeats. (On the same surface: what earlier pushes left
differently is no effect that is to be found, for the finder sees it in `before`.) With C the change of height,

    D = C' - C,   R = D less what the numbers of the base can do, fitted to D by least squares,
    q = sum R_1 R_2 / (sum N^2 / 2),

where N is the difference of C between the two worlds without effects, over pushes into freshly smoothed material, in
windows about the pushes. What its numbers can do is told by the derivatives of the base, fitted to the pushes without
the effect.
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
from pentimento.dynamics.pushes.analytic import first_model
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from studies.blind.strength import Strength, StrengthError
from studies.blind_pushes.collect import as_table, rows_with_and_without
from studies.blind_pushes.worlds import Sketch

PUSHES = 36
SEEDS = (1_000_001, 1_000_002)  # added to the world's: none is the one that is recorded
STRONGEST = 3.0
USUAL = 0.3
TOLERANCE = 0.2
EVALUATIONS = 4

Array = NDArray[Any]


class Trial(NamedTuple):
    """A part of a world's design, made without any effect in both of the trial's worlds."""

    sketch: Sketch
    quiet: tuple[PushSamples, PushSamples]


def prepare_trial(sketch: Sketch) -> Trial:
    """Make the pushes without any effect."""
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

    Raises StrengthError where even the strongest effect stays below.
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
    """With the effects, and each push without."""
    config = replace(sketch.config, pushes=PUSHES, repeated=0, times=1)
    both = rows_with_and_without(sketch, sketch.with_strengths(strengths), sketch.seed + seed, config)
    loud, quiet = (cropped(load_pushes(as_table(rows, {}), PIXELS_PER_M)[0]) for rows in both)
    return loud, quiet


def _change(samples: PushSamples) -> Array:
    """Millimetres, [N, H, W]."""
    return (samples.after.astype(np.float64) - samples.before) * 1e3


def absorbed(quiet: PushSamples) -> Array:
    """What the finder's base, fitted to pushes without the effect, can do to each change, [P, N, H, W]."""
    measured = measure_pushes(quiet)
    base = fit(first_model(measured.scene), measured)
    return derivatives(base, measured.scene).astype(np.float64)


def rest_of(difference: Array, can_do: Array) -> Array:
    """What is left of a difference [N, H, W] less a combination of [P, N, H, W], by least squares."""
    flat = can_do.reshape(len(can_do), -1)
    weights = np.linalg.lstsq(flat @ flat.T, flat @ difference.ravel(), rcond=1e-9)[0]
    return np.asarray(difference - (weights @ flat).reshape(difference.shape))
