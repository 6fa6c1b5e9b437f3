"""How strong an effect on pushes is, and the strength that gives a wanted one.

As for strokes (`studies/blind/strength.py`), q is the energy of an effect that the finder's base cannot absorb, over
the noise floor, measured in pairs: the same commands with and without the effect under the same random numbers, in two
worlds that differ in all that differs between repeats. With C the change of height of a push,

    D = C' - C,   R = D less what the base's modes, fitted to D by least squares, can do,
    q = sum R_1 R_2 / (sum N^2 / 2),

where N is the difference of C between the two worlds, over pushes into freshly smoothed material, in windows about the
pushes. The modes: amplitude (alone, by depth), width, shift along, halos of three widths, ahead and behind, the end.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.gap.pushes.measured import PIXELS_PER_M, cropped
from pentimento.push_dynamics.analytic_scene import local_places
from pentimento.push_dynamics.measured import PushSamples, load_pushes
from studies.blind.strength import Strength, StrengthError
from studies.blind_pushes.collect import as_table, recorded_rows
from studies.blind_pushes.worlds import Sketch

PUSHES = 36
SEEDS = (1_000_001, 1_000_002)  # added to the world's: none is the one that is recorded
STRONGEST = 3.0
USUAL = 0.3
TOLERANCE = 0.2
EVALUATIONS = 4
_HALOS_PX = (1.5, 3.0, 6.0)

Array = NDArray[Any]


class Trial(NamedTuple):
    """A part of a world's design, made without any effect in both of the trial's worlds."""

    sketch: Sketch
    quiet: tuple[PushSamples, PushSamples]


def prepare_trial(sketch: Sketch) -> Trial:
    """Make the pushes without any effect."""
    one, two = (_made(sketch, {}, seed) for seed in SEEDS)
    return Trial(sketch, (one, two))


def measure(trial: Trial, effect: str, strength: float) -> Strength:
    """q of one effect alone at a strength, and its standard error over the pushes."""
    loud = [_made(trial.sketch, {effect: strength}, seed) for seed in SEEDS]
    rests, noise = [], []
    for quiet, with_effect in zip(trial.quiet, loud, strict=True):
        known = quiet.known & with_effect.known
        difference = np.where(known, _change(with_effect) - _change(quiet), 0.0)
        rests.append(_rest(difference, _modes(quiet) * known))
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


def _made(sketch: Sketch, strengths: dict[str, float], seed: int) -> PushSamples:
    rows = recorded_rows(sketch, sketch.with_strengths(strengths), sketch.seed + seed, PUSHES)
    samples, _ = load_pushes(as_table(rows, {}), PIXELS_PER_M)
    return cropped(samples)


def _change(samples: PushSamples) -> Array:
    """Millimetres, [N, H, W]."""
    return (samples.after.astype(np.float64) - samples.before) * 1e3


def _modes(samples: PushSamples) -> Array:
    """What the finder's base can do to each change, [M, N, H, W]."""
    change = _change(samples)
    along, across = local_places(samples.window_m, change.shape[1:], samples.action, samples.pixels_per_m)
    length, depth = samples.action[:, 3, None, None], samples.action[:, 4, None, None]
    down, right = np.gradient(change, axis=(1, 2))
    cos, sin = np.cos(samples.action[:, 2])[:, None, None], np.sin(samples.action[:, 2])[:, None, None]
    forward = cos * right - sin * down
    halos = [np.stack([cv2.GaussianBlur(one, (0, 0), width) for one in change]) for width in _HALOS_PX]
    progress = np.clip((along - length / 2) / (length / 2 + 0.008), -1, 1)
    rims = np.maximum(change, 0)
    end = np.exp(-(np.square(along - length) + np.square(across)) / (2 * 0.004**2))
    deeper = depth / 0.006 - 1
    return np.stack(
        [
            change, change * deeper, np.square(change) * np.sign(change), np.hypot(down, right), forward, *halos,
            progress * rims, end, end * deeper,
        ]
    )  # fmt: skip


def _rest(difference: Array, modes: Array) -> Array:
    flat = modes.reshape(len(modes), -1)
    weights = np.linalg.lstsq(flat @ flat.T, flat @ difference.ravel(), rcond=1e-9)[0]
    return np.asarray(difference - (weights @ flat).reshape(difference.shape))
