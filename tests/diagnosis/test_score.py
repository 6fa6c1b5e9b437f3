"""Score tests and held-out gains on linear worlds whose truth is known, and beside a published implementation."""

import numpy as np
import pytest
from scipy.stats import kstest
from wildboottest.wildboottest import WildboottestCL

from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.score import (
    evidence_for,
    held_out_gains,
    information,
    mean_over_actions,
    projected_scores,
    scatter,
    score_statistic,
    score_tests,
)

BOTH = (information, scatter)

ACTIONS, PIXELS, NUISANCES, CANDIDATES = 60, 40, 3, 4


def regression(seed: int, effect: float = 0.0, shared: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A linear model, columns [n, pixels, P] and y [n, pixels]: candidate 0 matters by ``effect``; pixels of an action
    share an error.

    Each candidate's column is one number for an action times a fixed profile, like a covariate's effect on width.
    """
    rng = np.random.default_rng(seed)
    profile = rng.normal(size=PIXELS)
    nuisance = rng.normal(size=(ACTIONS, PIXELS, NUISANCES))
    covariates = rng.normal(size=(ACTIONS, 1, CANDIDATES))
    candidate = covariates * profile[None, :, None]
    error = rng.normal(size=(ACTIONS, PIXELS)) + shared * rng.normal(size=(ACTIONS, 1)) * profile
    return np.concatenate([nuisance, candidate], axis=2), effect * candidate[..., 0] + error


def world(seed: int, effect: float = 0.0, shared: float = 1.0) -> Statistics:
    """Of such a regression, at the fitted nuisances."""
    return at_fitted_nuisances(*regression(seed, effect, shared))


def at_fitted_nuisances(columns: np.ndarray, y: np.ndarray) -> Statistics:
    nuisance = columns[..., :NUISANCES]
    y = y - nuisance @ np.linalg.lstsq(nuisance.reshape(-1, NUISANCES), y.ravel(), rcond=None)[0]
    return Statistics(
        np.einsum("nxp,nxq->npq", columns, columns), np.einsum("nxp,nx->np", columns, y), np.square(y).sum(1)
    )


HELD = np.arange(NUISANCES)
INDEX = {f"c{i}": np.array([NUISANCES + i]) for i in range(CANDIDATES)}


def test_projected_scores_are_orthogonal_to_nuisances() -> None:
    statistics = world(0)
    scores = projected_scores(statistics, HELD, np.array([3, 4]))
    refit = np.linalg.solve(statistics.curvature.sum(0)[:3, :3], statistics.curvature.sum(0)[:3, 3:5])
    np.testing.assert_allclose(scores, statistics.slope[:, 3:5] - statistics.slope[:, :3] @ refit, atol=1e-4)


def test_p_is_uniform_under_the_null_with_clustered_errors() -> None:
    single = [score_tests(world(seed), HELD, INDEX, draws=199, seed=seed)["c1"][0] for seed in range(150)]
    assert kstest(single, "uniform").pvalue > 0.01
    any_name = [
        min(p for _, p in score_tests(world(seed), HELD, INDEX, draws=199, seed=seed).values()) <= 0.05
        for seed in range(150)
    ]
    assert np.mean(any_name) < 0.12


def test_evidence_belongs_to_candidates_of_any_number_of_quantities() -> None:
    """The first candidate matters; it is found as the second of one number, and as a part of the first of two."""
    statistics, blocks = world(4, effect=0.8), np.arange(ACTIONS) // 3
    single = evidence_for(statistics, NUISANCES, {"c0": 1, "c1": 1, "rest": 2}, block=blocks, seed=0)
    assert single["c0"].p_adjusted < 0.02 and single["c0"].min_gain > 0
    assert all(single[name].gain < 0.1 * single["c0"].gain for name in ("c1", "rest"))
    paired = evidence_for(statistics, NUISANCES, {"both": 2, "others": 2}, block=blocks, seed=0)
    assert paired["both"].p_adjusted < 0.02 < paired["others"].p_adjusted
    assert paired["both"].gain == pytest.approx(single["c0"].gain, rel=0.1)


def test_pixelwise_likelihood_rejects_the_null_everywhere() -> None:
    """The trap that the action as a unit avoids: the same worlds, each pixel taken for an independent witness."""
    found = 0
    for seed in range(40):
        statistics = world(seed)
        curvature, slope = statistics.curvature.sum(0), statistics.slope.sum(0)
        ratio = slope[4] ** 2 / curvature[4, 4] / (statistics.energy.sum() / (ACTIONS * PIXELS))
        found += ratio > 6.63
    assert found > 20


def test_finds_the_true_effect_and_no_other() -> None:
    found = [score_tests(world(seed, effect=0.8), HELD, INDEX, draws=499, seed=seed) for seed in range(20)]
    assert np.mean([tests["c0"][1] < 0.02 for tests in found]) > 0.9
    assert np.mean([min(tests[f"c{i}"][1] for i in (1, 2, 3)) < 0.02 for tests in found]) < 0.2


def test_finds_cause_that_few_actions_show() -> None:
    """Paint is crossed in few strokes: divided by its own spread, over several numbers, such a score says nothing."""
    found: dict[int, list[bool]] = {1: [], 2: []}
    for seed in range(20):
        rng = np.random.default_rng([seed, 7])
        columns, y = regression(seed)
        seldom = (
            rng.normal(size=(ACTIONS, 1, 4))
            * rng.normal(size=(1, PIXELS, 4))
            * (np.arange(ACTIONS) < 14)[:, None, None]
        )
        y = y + 1.5 * seldom[..., 0]
        statistics = at_fitted_nuisances(np.concatenate([columns, seldom], axis=2), y)
        last = NUISANCES + CANDIDATES
        for scales in ((information,), BOTH):
            tests = score_tests(
                statistics, HELD, INDEX | {"seldom": np.arange(last, last + 4)}, draws=999, seed=seed, scales=scales
            )
            found[len(scales)].append(tests["seldom"][1] < 0.02)
    assert np.mean(found[1]) > 0.8 and np.mean(found[2]) > 0.7


def beside_what_scatters(seed: int, effect: float) -> tuple[Statistics, dict[str, np.ndarray]]:
    """A candidate of two numbers: of one, each action has a chance of its own; the other is quiet, and matters."""
    rng = np.random.default_rng([seed, 8])
    columns, y = regression(seed, shared=3.0)
    quiet = rng.normal(size=(ACTIONS, 1)) * rng.normal(size=PIXELS)
    columns, y = np.concatenate([columns, quiet[..., None]], axis=2), y + effect * quiet
    return at_fitted_nuisances(columns, y), {"both": np.array([NUISANCES, NUISANCES + CANDIDATES])}


def test_scatter_metric_finds_quantity_beside_a_noisy_one() -> None:
    by_error, by_scatter = [], []
    for seed in range(20):
        statistics, candidate = beside_what_scatters(seed, 0.4)
        by_error.append(score_tests(statistics, HELD, candidate, draws=499, seed=seed)["both"][0])
        by_scatter.append(score_tests(statistics, HELD, candidate, draws=499, seed=seed, scales=BOTH)["both"][0])
    assert np.mean(np.array(by_scatter) < 0.02) > 0.8 > 0.4 > np.mean(np.array(by_error) < 0.02)


def test_p_is_uniform_under_the_null_with_both_metrics() -> None:
    worlds = (beside_what_scatters(seed, 0.0) for seed in range(150))
    p = [score_tests(world, HELD, candidate, draws=199, seed=0, scales=BOTH)["both"][0] for world, candidate in worlds]
    assert kstest(p, "uniform").pvalue > 0.01


def published(seed: int, effect: float) -> WildboottestCL:
    """The wild cluster bootstrap of wildboottest (null imposed, Rademacher) for candidate 0 without the others."""
    columns, y = regression(seed, effect)
    x = columns[..., : NUISANCES + 1].reshape(-1, NUISANCES + 1)
    action, only = np.repeat(np.arange(ACTIONS), PIXELS), np.eye(NUISANCES + 1)[NUISANCES]
    boot = WildboottestCL(X=x, Y=y.ravel(), cluster=action, R=only, B=4999, seed=seed, parallel=False)
    boot.get_scores(bootstrap_type="11", impose_null=True)
    boot.get_weights(weights_type="rademacher")
    boot.get_numer()
    return boot


@pytest.mark.parametrize("effect", [0.0, 0.3])
def test_scores_equal_those_of_wildboottest(effect: float) -> None:
    """Action by action they are its restricted scores over the candidate's information, for any signs."""
    for seed in range(4):
        boot, statistics = published(seed, effect), world(seed, effect)
        scores = projected_scores(statistics, HELD, INDEX["c0"])
        information = 1 / np.linalg.inv(boot.tXX)[NUISANCES, NUISANCES]
        np.testing.assert_allclose(scores[:, 0], information * boot.Cg, rtol=1e-4, atol=1e-6 * np.abs(boot.Cg).max())
        ours = score_statistic(boot.v.T @ scores, np.array([[information]]))
        np.testing.assert_allclose(ours, information * np.square(boot.numer), rtol=1e-3, atol=1e-9)


def test_p_equals_that_of_wildboottest() -> None:
    """It divides each draw by its own standard error, we all draws by one: for 60 actions nearly the same."""
    ours, theirs = [], []
    for seed, effect in enumerate(np.tile([0.0, 0.0, 0.15, 0.3], 3)):
        boot = published(seed, effect)
        boot.get_denom()
        boot.get_tboot()
        boot.get_vcov()
        boot.get_tstat()
        boot.get_pvalue()
        theirs.append(float(boot.pvalue))
        ours.append(score_tests(world(seed, effect), HELD, {"c0": INDEX["c0"]}, draws=4999, seed=seed)["c0"][0])
    np.testing.assert_allclose(ours, theirs, atol=0.03)
    assert min(theirs) < 0.01 and max(theirs) > 0.5


def test_adjusted_p_is_at_least_the_single_p() -> None:
    for p, adjusted in score_tests(world(3, effect=0.3), HELD, INDEX, draws=499, seed=0).values():
        assert adjusted >= p


def test_held_out_gain_equals_the_effects_error() -> None:
    effect = 1.0
    statistics = world(5, effect=effect)
    gains = held_out_gains(statistics, HELD, INDEX["c0"], block=np.arange(ACTIONS), seed=0)
    true = effect**2 * statistics.curvature[:, 3, 3].mean()
    assert gains.mean() == pytest.approx(true, rel=0.5)
    assert mean_over_actions(gains, 499, 0).interval[0] > 0
    inactive = held_out_gains(world(5), HELD, INDEX["c1"], block=np.arange(ACTIONS), seed=0)
    assert abs(inactive.mean()) < 0.15 * true
