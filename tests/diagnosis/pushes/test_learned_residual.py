"""What a tool does alike in every push is learnt; what a cause does, and what scatters, is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.pushes.fit import fit
from pentimento.diagnosis.pushes.jacobian import linearise, mean_squared_error, residual
from pentimento.diagnosis.pushes.learned_residual import learn_residual
from pentimento.diagnosis.pushes.measured import MeasuredPushes, measure
from pentimento.diagnosis.pushes.noise import by_scatter
from pentimento.dynamics.pushes.analytic import AnalyticPush, first_model, identity
from pentimento.dynamics.pushes.mechanisms import Mechanism
from pentimento.dynamics.pushes.mechanisms.stiffness_drift import StiffnessDrift
from pentimento.dynamics.pushes.mechanisms.volume_loss import VolumeLoss
from tests.dynamics.pushes.played_pushes import mechanism, played

Session = tuple[MeasuredPushes, AnalyticPush, list[Mechanism]]

KNOWN, FRESH = np.arange(45), np.arange(45, 70)


@pytest.fixture(scope="module")
def session() -> Session:
    """Pushes that their model foretells but for noise, and causes to look for."""
    measured = measure(played())
    assert len(measured) == FRESH[-1] + 1
    causes: list[Mechanism] = [identity(kind, measured.scene) for kind in (VolumeLoss, StiffnessDrift)]
    return measured, fit(first_model(measured.scene), measured.pick(KNOWN)), causes


@pytest.fixture(scope="module")
def lipped(session: Session) -> tuple[MeasuredPushes, AnalyticPush]:
    """The same with a narrow lip on both sides of every way, and a model that does what it can."""
    measured, model, _ = session
    scene = measured.scene
    beside = (scene.along > 0) & (scene.along < scene.action[:, 3, None, None])
    lip_m = 3e-4 * np.exp(-(((np.abs(scene.across) / scene.half_width_m - 1.5) / 0.15) ** 2)) * beside
    with_lips = replace(measured, after=(measured.after + lip_m).astype(np.float32))
    return with_lips, fit(model, with_lips.pick(KNOWN))


def error(model: AnalyticPush, measured: MeasuredPushes, rows: np.ndarray) -> float:
    return float(mean_squared_error(residual(model, measured), measured)[rows].mean())


def test_a_lip_that_all_pushes_have_is_foretold_of_fresh_pushes(
    session: Session, lipped: tuple[MeasuredPushes, AnalyticPush]
) -> None:
    plain, clean, causes = session
    measured, model = lipped
    _, learnt = learn_residual(measured, model, KNOWN, causes, 0)
    noise = error(clean, plain, FRESH)
    assert error(model, learnt, FRESH) - noise < 0.5 * (error(model, measured, FRESH) - noise)


def test_no_score_of_the_base_changes_though_the_misfit_falls(
    session: Session, lipped: tuple[MeasuredPushes, AnalyticPush]
) -> None:
    measured, model = lipped
    _, learnt = learn_residual(measured, model, KNOWN, session[2], 0)
    before, after = (linearise(model, m.pick(KNOWN)) for m in (measured, learnt))
    unit = np.sqrt(np.einsum("npp->p", before.curvature) * before.energy.sum())
    free = unit > 1e-6 * unit.max()  # a profile's outermost part, which no contact reaches
    changed = (before.slope.sum(0) - after.slope.sum(0))[free]
    np.testing.assert_allclose(changed / unit[free], 0.0, atol=1e-2)  # the edge bends within a step
    assert after.energy.sum() < 0.97 * before.energy.sum()  # most of it is noise


def test_a_cause_that_acts_alike_in_every_push_is_no_habit() -> None:
    """Lost volume shows at the same places about all ways; trees could learn it, and must leave it."""
    samples = played([mechanism(VolumeLoss, played(), lost_share=0.5)])
    measured = measure(samples)
    lost = identity(VolumeLoss, measured.scene)
    model = fit(first_model(measured.scene), measured.pick(KNOWN))
    full = model.plus(lost)
    _, learnt = learn_residual(measured, model, KNOWN, [lost], 0)
    column = full.columns_of(VolumeLoss.cause)[0]
    before, after = (linearise(full, m.pick(KNOWN)).slope.sum(0)[column] for m in (measured, learnt))
    assert after == pytest.approx(before, rel=0.1)


def test_noise_is_not_learnt(session: Session) -> None:
    measured, model, causes = session
    _, learnt = learn_residual(measured, model, KNOWN, causes, 0)
    for rows in (KNOWN, FRESH):
        assert error(model, learnt, rows) < 1.03 * error(model, measured, rows)


def test_pushes_that_come_later_get_the_habits_that_the_others_have(
    session: Session, lipped: tuple[MeasuredPushes, AnalyticPush]
) -> None:
    measured, model = lipped
    learned_residual, learnt = learn_residual(measured, model, KNOWN, session[2], 0)
    np.testing.assert_allclose(learned_residual.of(measured.pick(FRESH)).habit, learnt.habit[FRESH], atol=1e-5)


def test_a_lip_is_learnt_from_pushes_that_came_to_lie_apart(lipped: tuple[MeasuredPushes, AnalyticPush]) -> None:
    """What scatters with each push's place and depth is not in the way: much the same is learnt as without it."""
    measured, model = lipped
    beside_m = 2e-4 * np.random.default_rng(4).standard_normal((len(measured), 3))
    by = by_scatter(model, measured.scene)
    apart = np.einsum("bk,kbhw->bhw", beside_m, by).astype(np.float32)
    scattered = replace(measured, after=measured.after + apart)
    calm, found = (learn_residual(each, model, KNOWN, [], 0)[1].habit[FRESH] for each in (measured, scattered))
    assert np.square(apart[FRESH] * 1e3).sum() > np.square(calm).sum()
    assert np.square(found - calm).sum() < 0.3 * np.square(calm).sum()


def test_from_all_pushes_together_the_habits_of_fresh_ones_are_known_better(
    session: Session, lipped: tuple[MeasuredPushes, AnalyticPush]
) -> None:
    plain, clean, causes = session
    measured, model = lipped
    learned_residual, learnt = learn_residual(measured, model, KNOWN[: len(KNOWN) // 2], causes, 0)
    more, known = learned_residual.learnt_from_all(learnt, KNOWN)
    np.testing.assert_array_equal(known.habit[KNOWN], learnt.habit[KNOWN])
    np.testing.assert_allclose(more.of(measured.pick(FRESH)).habit, known.habit[FRESH], atol=1e-5)
    noise = error(clean, plain, FRESH)
    assert error(model, known, FRESH) - noise < 0.9 * (error(model, learnt, FRESH) - noise)
