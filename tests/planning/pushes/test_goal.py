"""Goals fitted to clay: as much material, within the table, the border kept, as strong as that allows."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.planning.pushes.goal import (
    GoalError,
    GoalSettings,
    border_mask,
    fit_goal,
)

SETTINGS = GoalSettings(
    volume_weight=1.0, floor_weight=100.0, range_weight=0.01, rising_share=1.0, depth_m=0.006, border_share=0.1
)
CLAY = np.random.default_rng(0).normal(0.04, 1e-4, (40, 40)).astype(np.float32)
X = np.tile(np.arange(40.0), (40, 1))
INSIDE = ~border_mask(CLAY.shape, 0.1)


def test_fit_goal_keeps_the_border() -> None:
    goal = fit_goal(X, CLAY, SETTINGS).height_m
    assert INSIDE.sum() == 32 * 32
    np.testing.assert_array_equal(goal[~INSIDE], CLAY[~INSIDE])


def test_fit_goal_is_affine_in_the_relief_inside_the_border() -> None:
    fit = fit_goal(X, CLAY, SETTINGS)
    np.testing.assert_allclose(fit.height_m[INSIDE], (fit.alpha * X + fit.beta_m)[INSIDE], atol=1e-6)


def test_fit_goal_conserves_volume_and_reaches_the_floor() -> None:
    fit = fit_goal(X, CLAY, SETTINGS)
    assert fit.material_share == pytest.approx(1.0, abs=1e-3)
    # Closed form: the mean stays and the lowest column, half the range below it, is as deep as tools reach.
    assert fit.alpha * np.ptp(X[INSIDE]) == pytest.approx(2 * 0.006, rel=0.02)
    assert fit.height_m[INSIDE].min() == pytest.approx(CLAY[INSIDE].mean() - 0.006, abs=1e-4)


def test_fit_goal_is_invariant_to_scale_and_offset_of_the_relief() -> None:
    one, other = fit_goal(X, CLAY, SETTINGS), fit_goal(1e-3 * X - 7.0, CLAY, SETTINGS)
    np.testing.assert_allclose(one.height_m, other.height_m, atol=1e-7)
    assert other.alpha == pytest.approx(1e3 * one.alpha, rel=1e-6)


def test_fit_goal_stays_above_the_table() -> None:
    deep = GoalSettings(
        volume_weight=1.0, floor_weight=100.0, range_weight=0.01, rising_share=1.0, depth_m=0.5, border_share=0.1
    )
    fit = fit_goal(X, CLAY, deep)
    assert fit.height_m.min() >= 0
    assert fit.height_m[INSIDE].min() < 0.002  # and goes down to it


def test_fit_goal_raises_and_counts_pixels_below_the_floor() -> None:
    relief = X.copy()
    relief[20, 20] = -400.0
    strong = GoalSettings(
        volume_weight=1.0, floor_weight=1.0, range_weight=0.002, rising_share=1.0, depth_m=0.006, border_share=0.1
    )
    fit = fit_goal(relief, CLAY, strong)
    assert fit.raised >= 1
    assert fit.height_m.min() >= CLAY[INSIDE].mean() - 0.006 - 1e-6


def test_lower_volume_weight_raises_the_relief() -> None:
    dent = np.where(np.hypot(X - 20, X.T - 20) < 5, -1.0, 0.0)
    alphas = [fit_goal(dent, CLAY, GoalSettings(volume, 100.0, 5.0, 1.0, 0.006, 0.1)).alpha for volume in (100.0, 1.0)]
    assert alphas[1] > alphas[0] > 0


def test_fit_goal_minimises_the_cost() -> None:
    dent = np.where(np.hypot(X - 20, X.T - 20) < 9, -1.0, 0.01 * X)
    settings = GoalSettings(
        volume_weight=2.0, floor_weight=30.0, range_weight=3.0, rising_share=1.0, depth_m=0.004, border_share=0.1
    )
    fit = fit_goal(dent, CLAY, settings)
    clay = float(CLAY[INSIDE].mean(dtype=np.float64))

    def cost(alpha: float, beta: float) -> float:
        goal = alpha * dent[INSIDE] + beta
        below = np.maximum(clay - settings.depth_m - goal, 0).mean() * 1e3
        definition = 1e3 * alpha * np.ptp(dent[INSIDE])
        volume = (1e3 * (goal.mean() - clay)) ** 2
        return float(
            settings.volume_weight * volume + settings.floor_weight * below - settings.range_weight * definition
        )

    minimum = cost(fit.alpha, fit.beta_m)
    rng = np.random.default_rng(1)
    for d_alpha, d_beta in rng.normal(0, 1e-4, (200, 2)):
        assert cost(max(fit.alpha + d_alpha, 0), fit.beta_m + d_beta) >= minimum - 1e-6


def test_fit_goal_respects_the_kept_share_of_volume() -> None:
    dent = np.where(np.hypot(X - 20, X.T - 20) < 8, -1.0, 0.0)
    flat = np.full_like(CLAY, 0.04)
    for kept in (0.0, 0.3, 1.0):
        rise = fit_goal(dent, flat, replace(SETTINGS, rising_share=kept)).height_m - flat
        raised, pressed = np.maximum(rise, 0)[INSIDE].mean(), np.maximum(-rise, 0)[INSIDE].mean()
        assert raised == pytest.approx(kept * pressed, abs=1e-5)
        assert pressed > 5e-4


def test_flat_relief_gives_smooth_clay() -> None:
    fit = fit_goal(np.full(CLAY.shape, 3.0), CLAY, SETTINGS)
    assert fit.alpha == 0
    np.testing.assert_allclose(fit.height_m[INSIDE], CLAY[INSIDE].mean(), atol=1e-7)


@pytest.mark.parametrize(
    ("relief", "clay", "settings", "sentence"),
    [
        (X[1:], CLAY, SETTINGS, "scan's grid"),
        (np.where(X == 3, np.nan, X), CLAY, SETTINGS, "relief has 40 holes"),
        (X, np.full_like(CLAY, np.nan), SETTINGS, "clay has 1600 holes"),
        (X, 1000 * CLAY, SETTINGS, "metres above the table"),
        (X, CLAY, GoalSettings(1.0, 0.001, 50.0, 1.0, 0.006, 0.1), "without end"),
    ],
)
def test_fit_goal_rejects_invalid_inputs(
    relief: np.ndarray, clay: np.ndarray, settings: GoalSettings, sentence: str
) -> None:
    with pytest.raises(GoalError, match=sentence):
        fit_goal(relief, clay, settings)
