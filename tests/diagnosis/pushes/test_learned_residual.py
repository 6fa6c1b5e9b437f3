"""Learned residual of pushes: systematic errors are learned, causes and noise are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.floor import noise_derivatives
from pentimento.diagnosis.pushes.jacobian import linearise, mean_squared_error, residual
from pentimento.diagnosis.pushes.learned_residual import learn_residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.planning.pushes.analytic.mechanisms import Mechanism
from pentimento.planning.pushes.analytic.mechanisms.stiffness_drift import StiffnessDrift
from pentimento.planning.pushes.analytic.mechanisms.volume_loss import VolumeLoss
from pentimento.planning.pushes.analytic.model import AnalyticPush, first_model, identity
from tests.dynamics.pushes.played_pushes import mechanism, played

Session = tuple[MeasuredPushes, AnalyticPush, list[Mechanism]]

KNOWN, NEW = np.arange(45), np.arange(45, 70)


@pytest.fixture(scope="module")
def session() -> Session:
    """Pushes that their model predicts up to noise, and candidate causes."""
    measured = measure(played())
    assert len(measured) == NEW[-1] + 1
    causes: list[Mechanism] = [identity(kind, measured.scene) for kind in (VolumeLoss, StiffnessDrift)]
    return measured, fit(first_model(measured.scene), measured.pick(KNOWN)), causes


@pytest.fixture(scope="module")
def lipped(session: Session) -> tuple[MeasuredPushes, AnalyticPush]:
    """The same with a narrow lip on both sides of every path, and a model refitted to them."""
    measured, model, _ = session
    scene = measured.scene
    beside = (scene.along > 0) & (scene.along < scene.action[:, 3, None, None])
    lip_m = 3e-4 * np.exp(-(((np.abs(scene.across) / scene.half_width_m - 1.5) / 0.15) ** 2)) * beside
    with_lips = replace(measured, after=(measured.after + lip_m).astype(np.float32))
    return with_lips, fit(model, with_lips.pick(KNOWN))


def error(model: AnalyticPush, measured: MeasuredPushes, rows: np.ndarray) -> float:
    return float(mean_squared_error(residual(model, measured), measured)[rows].mean())


def test_learned_residual_predicts_systematic_lip_of_new_pushes(
    session: Session, lipped: tuple[MeasuredPushes, AnalyticPush]
) -> None:
    plain, clean, causes = session
    measured, model = lipped
    _, learned = learn_residual(measured, model, KNOWN, candidates=causes, seed=0)
    noise = error(clean, plain, NEW)
    assert error(model, learned, NEW) - noise < 0.5 * (error(model, measured, NEW) - noise)


def test_learned_residual_keeps_scores_of_base(session: Session, lipped: tuple[MeasuredPushes, AnalyticPush]) -> None:
    measured, model = lipped
    _, learned = learn_residual(measured, model, KNOWN, candidates=session[2], seed=0)
    before, after = (linearise(model, m.pick(KNOWN)) for m in (measured, learned))
    unit = np.sqrt(np.einsum("npp->p", before.curvature) * before.energy.sum())
    free = unit > 1e-6 * unit.max()  # excludes profile offsets that no contact reaches
    changed = (before.slope.sum(0) - after.slope.sum(0))[free]
    np.testing.assert_allclose(changed / unit[free], 0.0, atol=1e-2)  # the edge is nonlinear within a step
    assert after.energy.sum() < 0.97 * before.energy.sum()  # most of it is noise


def test_learned_residual_excludes_systematic_cause() -> None:
    """Volume loss changes the same places around all paths; trees could learn it, and must not."""
    samples = played([mechanism(VolumeLoss, played(), lost_share=0.5)])
    measured = measure(samples)
    lost = identity(VolumeLoss, measured.scene)
    model = fit(first_model(measured.scene), measured.pick(KNOWN))
    full = model.plus(lost)
    _, learned = learn_residual(measured, model, KNOWN, candidates=[lost], seed=0)
    column = full.columns_of(VolumeLoss.cause)[0]
    before, after = (linearise(full, m.pick(KNOWN)).slope.sum(0)[column] for m in (measured, learned))
    assert after == pytest.approx(before, rel=0.1)


def test_learned_residual_does_not_fit_noise(session: Session) -> None:
    measured, model, causes = session
    _, learned = learn_residual(measured, model, KNOWN, candidates=causes, seed=0)
    for rows in (KNOWN, NEW):
        assert error(model, learned, rows) < 1.03 * error(model, measured, rows)


def test_learned_residual_of_new_pushes_matches_cross_fit(
    session: Session, lipped: tuple[MeasuredPushes, AnalyticPush]
) -> None:
    measured, model = lipped
    learned_residual, learned = learn_residual(measured, model, KNOWN, candidates=session[2], seed=0)
    np.testing.assert_allclose(learned_residual.of(measured.pick(NEW)).learned_mm, learned.learned_mm[NEW], atol=1e-5)


def test_learned_residual_is_robust_to_execution_noise(lipped: tuple[MeasuredPushes, AnalyticPush]) -> None:
    """Nearly the same residual is learned with and without execution noise."""
    measured, model = lipped
    beside_m = 2e-4 * np.random.default_rng(4).standard_normal((len(measured), 3))
    by = noise_derivatives(model, measured.scene)
    apart = np.einsum("bk,kbhw->bhw", beside_m, by).astype(np.float32)
    scattered = replace(measured, after=measured.after + apart)
    calm, found = (
        learn_residual(each, model, KNOWN, candidates=[], seed=0)[1].learned_mm[NEW] for each in (measured, scattered)
    )
    assert np.square(apart[NEW] * 1e3).sum() > np.square(calm).sum()
    assert np.square(found - calm).sum() < 0.3 * np.square(calm).sum()
