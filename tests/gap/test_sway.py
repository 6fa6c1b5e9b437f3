"""Random effects, and residuals of which they are not counted."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.gap.fit import first_model, fit, weighted
from pentimento.gap.foretell import Model, residual, weighted_error
from pentimento.gap.jacobian import linearise_rows
from pentimento.gap.measured import Measured, load_measured
from pentimento.gap.sway import alikeness, inverse_root, random_effects, with_sway


@pytest.fixture(scope="module")
def swaying() -> tuple[Measured, Model]:
    measured = load_measured(example_table(40))
    model = fit(first_model(measured), measured)
    return with_sway(weighted(measured, model, measured), model, np.arange(30)), model


def drawn(noise: float, same: int, n: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Strokes r = M u + e of 200 numbers whose errors come in groups of ``same``; u of a known covariance."""
    rng = np.random.default_rng(3)
    covariance = np.array([[0.5, 0.2], [0.2, 0.3]])
    maps = rng.normal(size=(n, 200, 3))
    amount = rng.multivariate_normal(np.zeros(2), covariance, n)
    error = np.sqrt(noise) * np.repeat(rng.normal(size=(n, 200 // same)), same, axis=1)
    rest = np.einsum("npk,nk->np", maps[:, :, 1:], amount) + error
    return (
        covariance,
        np.einsum("npk,npj->nkj", maps, maps),
        np.einsum("npk,np->nk", maps, rest),
        (rest**2).sum(1),
        maps,
    )


def test_the_covariance_of_the_amounts_and_the_noise_are_found_again() -> None:
    covariance, overlap, pull, energy, _ = drawn(noise=4.0, same=1)
    spread, noise = random_effects(overlap[:, 1:, 1:], pull[:, 1:], energy, np.full(400, 200))
    np.testing.assert_allclose(spread, covariance, atol=0.08)
    assert noise == pytest.approx(4.0, rel=0.02)


def test_white_errors_are_not_alike_and_repeated_ones_count_once() -> None:
    _, overlap, pull, _, _ = drawn(noise=4.0, same=1)
    assert alikeness(overlap, pull, 4.0, ways=2) == pytest.approx(1.0, abs=0.2)
    rng = np.random.default_rng(4)
    smooth = np.repeat(rng.normal(size=(400, 20, 3)), 10, axis=1)  # directions that neighbours share
    error = 2 * np.repeat(rng.normal(size=(400, 20)), 10, axis=1)
    overlap, pull = np.einsum("npk,npj->nkj", smooth, smooth), np.einsum("npk,np->nk", smooth, error)
    assert alikeness(overlap, pull, 4.0, ways=2) == pytest.approx(10.0, rel=0.2)


def test_what_is_counted_is_the_same_quadratic_form_in_errors_and_in_derivatives(
    swaying: tuple[Measured, Model],
) -> None:
    measured, model = swaying
    few = measured.pick(np.arange(6))
    _, slope, energy = linearise_rows(model, few)
    np.testing.assert_allclose(energy, weighted_error(residual(model, few), few), rtol=1e-4)
    step = 1e-3
    for p in (0, 6, len(model.base)):  # a width, a slab, a colour
        shift = step * np.eye(len(model.vector))[p]
        up, down = (weighted_error(residual(model.at(model.vector + s * shift), few), few) for s in (1, -1))
        np.testing.assert_allclose(
            -(up - down) / (4 * step), slope[:, p], rtol=0.05, atol=0.02 * abs(slope[:, p]).max()
        )


def test_less_is_counted_but_never_less_than_nothing(swaying: tuple[Measured, Model]) -> None:
    measured, model = swaying
    rest = residual(model, measured)
    counted, whole = weighted_error(rest, measured), weighted_error(rest, measured.whole())
    assert (counted > 0).all() and (counted < whole).all()
    noise = np.random.default_rng(0).normal(0, 0.05, rest.shape).astype(np.float32)
    assert (weighted_error(noise, measured) > 0).all()


def test_a_stroke_that_is_darker_as_a_whole_costs_less_than_one_with_the_same_error_elsewhere(
    swaying: tuple[Measured, Model],
) -> None:
    measured, model = swaying
    darker = replace(model, base=model.base * np.where(np.arange(len(model.base)) == 6, 0.8, 1.0))
    change = residual(darker, measured.whole()) - residual(model, measured.whole())
    scattered = change * np.random.default_rng(1).choice((-1.0, 1.0), change.shape).astype(np.float32)
    shares = [
        weighted_error(c, measured).sum() / weighted_error(c, measured.whole()).sum() for c in (change, scattered)
    ]
    assert shares[0] < 0.8 * shares[1]
    assert shares[1] > 0.95


def test_the_root_is_that_of_the_inverse_even_where_rounding_spoils_the_matrix() -> None:
    rng = np.random.default_rng(0)
    factors = rng.standard_normal((5, 6, 6))
    matrices = factors @ factors.swapaxes(1, 2) + 0.1 * np.eye(6)
    root = inverse_root(matrices)
    np.testing.assert_allclose(root @ root.swapaxes(1, 2), np.linalg.inv(matrices), rtol=1e-8)
    spoilt = np.diag([1.0, 1e4, 1e9])[None] - 1e-2 * np.outer([1, 0, 1], [1, 0, 1])
    spoilt[0, 0, 0] = -1e-3
    assert np.isfinite(inverse_root(spoilt)).all()
