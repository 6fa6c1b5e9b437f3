"""Score tests, splits and signs of the engine against exact values."""

import itertools

import numpy as np
import pytest
from scipy.stats import gamma

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.problem import Cause, Quantity, Rows
from pentimento.diagnosis.search import sign_flip_p
from pentimento.diagnosis.splits import split


def test_the_gamma_approximation_has_the_exact_moments_of_all_sign_flips() -> None:
    rng = np.random.default_rng(0)
    slope = rng.normal(size=(11, 2)) * [1.0, 3.0]
    metric = np.array([[2.0, 0.4], [0.4, 9.0]])
    signs = np.array(list(itertools.product((-1, 1), repeat=11)))
    sums = signs @ slope
    drawn = np.einsum("rp,pq,rq->r", sums, np.linalg.inv(metric), sums)
    mean, variance = drawn.mean(), drawn.var()
    observed = slope.sum(0) @ np.linalg.solve(metric, slope.sum(0))
    expected = gamma.sf(observed, mean**2 / variance, scale=variance / mean)
    assert sign_flip_p(slope, metric) == pytest.approx(expected, rel=1e-4)


def test_p_is_uniform_under_random_signs() -> None:
    rng = np.random.default_rng(1)
    p = [sign_flip_p(rng.normal(size=(60, 2)), 60 * np.eye(2)) for _ in range(400)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.03)
    assert np.mean(p) == pytest.approx(0.5, abs=0.06)


def test_p_does_not_depend_on_the_unit_of_a_quantity() -> None:
    rng = np.random.default_rng(2)
    slope, scale = rng.normal(size=(40, 2)) + 0.2, np.array([1e-3, 1e4])
    one = sign_flip_p(slope, 40 * np.eye(2))
    assert sign_flip_p(slope * scale, 40 * np.diag(scale**2)) == pytest.approx(one, rel=1e-9)


def rows_of(action: np.ndarray) -> Rows:
    """Rows of these actions in their order, ten to a block."""
    turn = np.arange(len(action))
    return Rows(action, turn // 10, turn, {})


@pytest.mark.parametrize("seed", [0, 3])
def test_every_split_has_whole_actions_and_repeats(seed: int) -> None:
    action = np.concatenate([np.arange(60), np.repeat(np.arange(60, 80), 3)])
    parts = split(rows_of(action), seed)
    assert sorted(np.concatenate(parts).tolist()) == list(range(len(action)))
    of_action = [set(action[part].tolist()) for part in parts]
    assert not of_action[0] & of_action[1] and not of_action[0] & of_action[2] and not of_action[1] & of_action[2]
    assert [sum(a >= 60 for a in own) for own in of_action] == [5, 5, 10]
    assert [sum(a < 60 for a in own) for own in of_action] == [36, 12, 12]


def test_single_actions_of_a_block_stay_together() -> None:
    rows = rows_of(np.arange(100))
    parts = split(rows, 0)
    shared = [set(rows.block[a]) & set(rows.block[b]) for a, b in itertools.combinations(parts, 2)]
    assert sum(map(len, shared)) <= 2  # a share may end within a block


def test_splits_depend_on_the_seed_only() -> None:
    rows = rows_of(np.arange(80))
    once, again, other = split(rows, 0), split(rows, 0), split(rows, 1)
    assert all((a == b).all() for a, b in zip(once, again, strict=True))
    assert any(len(a) != len(b) or (a != b).any() for a, b in zip(once, other, strict=True))


def test_too_few_actions_end_in_a_sentence() -> None:
    with pytest.raises(ContractError, match="9 different actions"):
        split(rows_of(np.arange(9)), 0)


def test_a_cause_allows_what_its_signs_and_its_own_rule_allow() -> None:
    one_way = Cause("lag", (Quantity("distance", "m", 1e-3, signed=False),))
    assert one_way.allows(np.array([0.1])) and not one_way.allows(np.array([-0.1]))
    assert not one_way.allows(np.zeros(1))
    lens = Cause("lens", (Quantity("a", "1", 1.0), Quantity("b", "1", 1.0)), is_possible=lambda v: bool(v[0] > v[1]))
    assert lens.allows(np.array([2.0, 1.0])) and not lens.allows(np.array([1.0, 2.0]))
