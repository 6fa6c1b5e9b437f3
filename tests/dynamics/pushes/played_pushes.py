"""Synthetic push tables whose truth is an analytic model: executed in sequence on one slab, with scanner noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pentimento.contracts.height_maps import surface_at_m
from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.measured_scene import scene_of
from pentimento.planning.pushes.analytic.mechanisms import Mechanism
from pentimento.planning.pushes.analytic.model import AnalyticPush, first_model, identity

SIDE_M, PIXELS = 0.14, 84
WINDOW_M = (0.0, 0.0, SIDE_M, SIDE_M)
HALF_WIDTH_M = 0.006
DEEP_M = (0.003, 0.009)


def commands(actions: int, repeats: int, seed: int, per_reset: int = 5) -> dict[str, Any]:
    """Commands and covariates in random order: ``actions`` single ones, a quarter as many ``repeats`` times each."""
    rng = np.random.default_rng([seed, 41])
    low, high = [0.05, 0.05, -np.pi, 0.008, DEEP_M[0]], [SIDE_M - 0.05, SIDE_M - 0.05, np.pi, 0.03, DEEP_M[1]]
    again = actions // 4
    drawn = rng.uniform(low, high, (actions + again, 5))
    ids = np.concatenate([np.arange(actions), np.repeat(np.arange(actions, actions + again), repeats)])
    ids = rng.permutation(ids)
    n = len(ids)
    order = np.arange(n)
    start_s = order * 20.0 + rng.uniform(0, 60, n).cumsum()
    return {
        "action": drawn[ids],
        "action_id": ids,
        "covariates": {
            "order": order.astype(float),
            "reset_id": (order // per_reset).astype(float),
            "pushes_since_reset": (order % per_reset).astype(float),
            "speed_m_s": np.exp(rng.uniform(np.log(0.01), np.log(0.06), n)),
            "retract_speed_m_s": np.exp(rng.uniform(np.log(0.01), np.log(0.1), n)),
            "dwell_s": np.exp(rng.uniform(np.log(0.2), np.log(5), n)),
            "t_start_s": start_s,
            "t_after_s": start_s + rng.uniform(5, 60, n),
            "temperature_c": 22 + rng.standard_normal(n),
            "humidity": 0.4 + 0.1 * rng.standard_normal(n),
        },
    }


def played(
    mechanisms: Sequence[Mechanism] = (),
    actions: int = 40,
    repeats: int = 3,
    seed: int = 0,
    noise_m: float = 5e-5,
    depth_error_m: float = 1e-4,
    model: AnalyticPush | None = None,
    per_reset: int = 5,
) -> PushSamples:
    """Samples of a session: each push meets the surface left by the last; every ``per_reset`` pushes it is smoothed."""
    rng = np.random.default_rng([seed, 42])
    given = commands(actions, repeats, seed, per_reset)
    n = len(given["action"])
    scans = np.zeros((2, n, PIXELS, PIXELS), dtype=np.float32)
    height = np.zeros((PIXELS, PIXELS), dtype=np.float32)
    noise = noise_m * rng.standard_normal(scans.shape)
    given["action"] = given["action"].copy()
    commanded = given["action"].copy()
    given["action"][:, 4] += depth_error_m * rng.standard_normal(n)
    whole = samples_of(given, scans[0], scans[1])
    for b in range(n):
        if given["covariates"]["pushes_since_reset"][b] == 0:
            height = 0.04 + _waves(rng)
        one = whole.pick(np.arange(max(b - per_reset + 1, 0), b + 1))
        scans[0, b] = height
        one.before[-1], one.surface_m[-1] = height, surface_at_m(height, WINDOW_M, *one.action[-1, :2])
        scene = scene_of(one, HALF_WIDTH_M).pick(np.array([-1]))
        truth = (model or first_model_of(DEEP_M)).plus(*mechanisms)
        height = height + truth.change(scene)[0]
        scans[1, b] = height
    given["action"] = commanded
    return samples_of(given, *(scans + noise).astype(np.float32))


def first_model_of(deep_m: tuple[float, float]) -> AnalyticPush:
    """The true base: a ball with rims and a heap."""
    model = first_model(_flat(np.array([[0.07, 0.07, 0.0, 0.02, deep_m[1]]])))
    base = dict(zip(*_named(model), strict=True)) | {"facing": 0.7, "kept": 0.85}
    return model.at(np.array(list(base.values())))


def mechanism(kind: type[Mechanism], samples: PushSamples, **values: float) -> Mechanism:
    """A mechanism with the references of these samples and these quantities."""
    still = identity(kind, scene_of(samples, HALF_WIDTH_M))
    names = [quantity.name for quantity in kind.quantities]
    assert set(values) <= set(names), names
    return kind(np.array([values.get(name, 0.0) for name in names]), still.reference)


def blank(actions: int = 40, repeats: int = 3, seed: int = 0) -> PushSamples:
    """The same commands, with flat scans."""
    given = commands(actions, repeats, seed)
    flat = np.full((len(given["action"]), PIXELS, PIXELS), 0.04, dtype=np.float32)
    return samples_of(given, flat, flat.copy())


def samples_of(given: dict[str, Any], before: np.ndarray, after: np.ndarray) -> PushSamples:
    n, action = len(before), given["action"]
    names = {name: np.full(n, value) for name, value in (("session", "s"), ("tool", "ball"), ("material", "clay"))}
    surface_m = [surface_at_m(height, WINDOW_M, x, y) for height, (x, y) in zip(before, action[:, :2], strict=True)]
    return PushSamples(
        before=before, after=after, known=np.ones(before.shape, bool), action=action,
        window_m=np.tile(WINDOW_M, (n, 1)), pixels_per_m=PIXELS / SIDE_M, action_id=given["action_id"],
        surface_m=np.array(surface_m), kind=np.full(n, "push"), covariates=given["covariates"], **names,
    )  # fmt: skip


def _flat(action: np.ndarray) -> Any:
    columns = {"order": np.zeros(len(action))}
    flat = np.full((len(action), PIXELS, PIXELS), 0.04, dtype=np.float32)
    given = {"action": action, "action_id": np.arange(len(action)), "covariates": columns}
    return scene_of(samples_of(given, flat, flat), HALF_WIDTH_M)


def _named(model: AnalyticPush) -> tuple[Any, Any]:
    from pentimento.planning.pushes.analytic.model import BASE

    return BASE, model.base


def _waves(rng: np.random.Generator) -> np.ndarray:
    y, x = np.mgrid[:PIXELS, :PIXELS] / PIXELS * 2 * np.pi
    phase = rng.uniform(0, 2 * np.pi, 4)
    waves = np.sin(x + phase[0]) * np.sin(y + phase[1]) + np.sin(2 * x + phase[2]) * np.sin(2 * y + phase[3])
    return (2e-4 * waves).astype(np.float32)
