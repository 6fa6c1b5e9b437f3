"""Simpler methods of the benchmark: each names the true cause of a clean table, and pixels name false ones."""

import numpy as np
import pytest

from pentimento.diagnosis.gauss_newton import Statistics
from studies.blind.rivals import by_distortion, by_l1_path, by_pixels, by_posterior

HELD = np.array([0])
COLUMNS = {name: np.array([k]) for k, name in enumerate("abcd", 1)}
ACTIONS, PIXELS = 60, 200


def statistics(x: np.ndarray, y: np.ndarray) -> Statistics:
    """Sums by action of columns [n, N, P] and readings [n, N], at the fitted base."""
    base = x[..., :1]
    y = y - base[..., 0] * np.tensordot(base[..., 0], y) / np.tensordot(base[..., 0], base[..., 0])
    count = y.shape[1]
    curvature, slope = np.einsum("anp,anq->apq", x, x) / count, np.einsum("anp,an->ap", x, y) / count
    return Statistics(curvature, slope, np.square(y).mean(1))


def table(seed: int, effect: float) -> Statistics:
    """A base, four candidates, and an effect of the second one; every action has an error of its own."""
    rng = np.random.default_rng(seed)
    by_action = rng.standard_normal((ACTIONS, 1, 5))
    x = by_action * rng.standard_normal((1, PIXELS, 5)) + 0.3 * rng.standard_normal((ACTIONS, PIXELS, 5))
    own = rng.standard_normal((ACTIONS, 1)) * rng.standard_normal((1, PIXELS))
    return statistics(x, x[..., 0] + effect * x[..., 2] + 0.5 * own + rng.standard_normal((ACTIONS, PIXELS)))


def test_each_method_names_a_strong_cause() -> None:
    found = table(0, 0.8)
    block = np.arange(ACTIONS)
    assert by_posterior(found, HELD, COLUMNS) == ("b",)
    assert by_distortion(found, HELD, COLUMNS)[0] == "b"
    assert "b" in by_l1_path(found, HELD, COLUMNS, signed=np.ones(4, bool), block=block)
    assert by_pixels(found, HELD, COLUMNS, PIXELS)[0] == "b"


def test_methods_with_the_action_as_unit_name_little_where_nothing_is_hidden() -> None:
    false = {"posterior": 0, "distortion": 0}
    for seed in range(20):
        found = table(seed, 0.0)
        false["posterior"] += len(by_posterior(found, HELD, COLUMNS))
        false["distortion"] += len(by_distortion(found, HELD, COLUMNS))
    assert false["distortion"] <= 4  # 5 % a table
    assert false["posterior"] <= 16  # of 80: its likelihood takes no account of shared errors


def test_pixels_name_false_causes_where_the_pixels_of_an_action_share_their_error() -> None:
    named = 0
    for seed in range(20):
        rng = np.random.default_rng([seed, 1])
        by_action = np.broadcast_to(rng.standard_normal((ACTIONS, 1, 5)), (ACTIONS, PIXELS, 5))
        y = rng.standard_normal((ACTIONS, 1)) + rng.standard_normal((ACTIONS, PIXELS))
        named += len(by_pixels(statistics(by_action, y), HELD, COLUMNS, PIXELS))
    assert named > 40  # of 80, all false


@pytest.mark.parametrize("effect", [0.5, -0.5])
def test_an_unsigned_quantity_is_not_named_for_an_effect_below_0(effect: float) -> None:
    found, signed = table(3, effect), np.array([True, False, True, True])
    named = by_l1_path(found, HELD, COLUMNS, signed=signed, block=np.arange(ACTIONS))
    assert ("b" in named) == (effect > 0)
