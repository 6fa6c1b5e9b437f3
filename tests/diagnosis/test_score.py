"""Score tests and held-out gains on linear worlds whose truth is known, and beside a published implementation."""

import numpy as np
import pytest
from scipy.stats import kstest
from wildboottest.wildboottest import WildboottestCL

from pentimento.diagnosis.evaluation import mean_gain
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.rule import DEFAULT_RULE
from pentimento.diagnosis.score import held_out_gains, projected_scores, projected_statistics
from pentimento.diagnosis.search import sign_flip_p

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


def p_of(statistics: Statistics, candidate: np.ndarray) -> float:
    slope, curvature = projected_statistics(statistics, HELD, candidate)
    return sign_flip_p(slope, curvature.sum(0))


def enters(p: float, candidates: int) -> bool:
    return 1 - (1 - p) ** candidates < DEFAULT_RULE.entry_p


def test_projected_statistics_have_the_projected_scores() -> None:
    statistics, candidate = world(0), np.array([3, 4])
    slope, curvature = projected_statistics(statistics, HELD, candidate)
    np.testing.assert_allclose(slope, projected_scores(statistics, HELD, candidate), rtol=1e-9)
    total = statistics.curvature.sum(0)
    schur = total[3:5, 3:5] - total[3:5, :3] @ np.linalg.solve(total[:3, :3], total[:3, 3:5])
    np.testing.assert_allclose(curvature.sum(0), schur, rtol=1e-4)


def test_p_is_uniform_under_the_null_with_clustered_errors() -> None:
    assert kstest([p_of(world(seed), INDEX["c1"]) for seed in range(150)], "uniform").pvalue > 0.01
    assert kstest([p_of(world(seed), np.array([3, 4])) for seed in range(150)], "uniform").pvalue > 0.01


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
    found = [{name: p_of(world(seed, effect=0.8), index) for name, index in INDEX.items()} for seed in range(20)]
    assert np.mean([enters(p["c0"], CANDIDATES) for p in found]) > 0.9
    assert np.mean([enters(min(p[f"c{i}"] for i in (1, 2, 3)), CANDIDATES) for p in found]) < 0.2


def test_finds_cause_that_few_actions_show() -> None:
    """Paint is crossed in few strokes: divided by its own spread, over several numbers, such a score says nothing."""
    found = []
    for seed in range(20):
        rng = np.random.default_rng([seed, 7])
        columns, y = regression(seed)
        few = (np.arange(ACTIONS) < 14)[:, None, None]
        seldom = rng.normal(size=(ACTIONS, 1, 4)) * rng.normal(size=(1, PIXELS, 4)) * few
        statistics = at_fitted_nuisances(np.concatenate([columns, seldom], axis=2), y + 1.5 * seldom[..., 0])
        last = NUISANCES + CANDIDATES
        found.append(p_of(statistics, np.arange(last, last + 4)))
    assert np.mean([enters(p, CANDIDATES + 1) for p in found]) > 0.7


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
    """Action by action they are its restricted scores over the candidate's information."""
    for seed in range(4):
        boot, statistics = published(seed, effect), world(seed, effect)
        slope, curvature = projected_statistics(statistics, HELD, INDEX["c0"])
        information = 1 / np.linalg.inv(boot.tXX)[NUISANCES, NUISANCES]
        np.testing.assert_allclose(slope[:, 0], information * boot.Cg, rtol=1e-4, atol=1e-6 * np.abs(boot.Cg).max())
        assert curvature.sum() == pytest.approx(information, rel=1e-4)


def test_p_equals_that_of_wildboottest() -> None:
    """It divides each draw by its own standard error, and needs draws: for 60 actions nearly the same."""
    ours, theirs = [], []
    for seed, effect in enumerate(np.tile([0.0, 0.0, 0.15, 0.3], 3)):
        boot = published(seed, effect)
        boot.get_denom()
        boot.get_tboot()
        boot.get_vcov()
        boot.get_tstat()
        boot.get_pvalue()
        theirs.append(float(boot.pvalue))
        ours.append(p_of(world(seed, effect), INDEX["c0"]))
    np.testing.assert_allclose(ours, theirs, atol=0.03)
    assert min(theirs) < 0.01 and max(theirs) > 0.5


def test_held_out_gain_equals_the_effects_error() -> None:
    effect = 1.0
    statistics = world(5, effect=effect)
    gains = held_out_gains(statistics, HELD, INDEX["c0"], block=np.arange(ACTIONS), seed=0)
    true = effect**2 * statistics.curvature[:, 3, 3].mean()
    assert gains.mean() == pytest.approx(true, rel=0.5)
    assert mean_gain(gains, 0)[1][0] > 0
    inactive = held_out_gains(world(5), HELD, INDEX["c1"], block=np.arange(ACTIONS), seed=0)
    assert abs(inactive.mean()) < 0.15 * true
