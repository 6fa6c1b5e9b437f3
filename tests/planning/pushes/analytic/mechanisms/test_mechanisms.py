"""Mechanisms of pushes: properties that all share, and the effect of each."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from pentimento.diagnosis.pushes.modes import command_covariates
from pentimento.dynamics.pushes.measured_scene import scene_of
from pentimento.planning.pushes.analytic.mechanisms import UNNAMED, VOCABULARY, Mechanism
from pentimento.planning.pushes.analytic.mechanisms.mechanism import NotObservable, spread
from pentimento.planning.pushes.analytic.mechanisms.slope_slide import relaxed
from pentimento.planning.pushes.analytic.mechanisms.unnamed import Sinking
from pentimento.planning.pushes.analytic.model import BASE, AnalyticPush, first_model, identity, touch
from pentimento.planning.pushes.analytic.scene import PushScene
from tests.dynamics.documented_causes import documented_causes
from tests.dynamics.pushes.played_pushes import HALF_WIDTH_M, blank

KINDS = {kind.cause: kind for kind in VOCABULARY}


@pytest.fixture(scope="module")
def seen() -> PushScene:
    scene = scene_of(blank(24, 2), HALF_WIDTH_M)
    rng = np.random.default_rng(3)
    rough = 2e-4 * rng.standard_normal(scene.before.shape).astype(np.float32)
    return replace(scene, before=scene.before + rough)


@pytest.fixture(scope="module")
def base(seen: PushScene) -> AnalyticPush:
    model = first_model(seen)
    return model.at(
        np.where(np.array(BASE) == "give_mm", 1.0, model.base)
    )  # compliant, so that hardening has an effect


def with_values(kind: type[Mechanism], seen: PushScene, *values: float) -> Mechanism:
    return kind(np.array(values), identity(kind, seen).reference)


def typical(kind: type[Mechanism]) -> list[float]:
    return [quantity.typical for quantity in kind.quantities]


def test_every_cause_is_described_in_the_documentation_and_no_other() -> None:
    assert sorted(KINDS) == sorted(documented_causes("pushes"))


def test_hidden_causes_depend_on_more_than_the_pose() -> None:
    # A network in the push's own pose sees the surface around the push: what depends on nothing else is not hidden.
    visible = {kind.cause for kind in VOCABULARY if not kind.hidden_from_network}
    assert visible == {"far_field", "slope_slide", "volume_loss"}


def test_informative_covariates_are_known_columns(seen: PushScene) -> None:
    names = {name for kind in VOCABULARY for name in kind.informative_covariates}
    assert names <= set(seen.covariates) | set(
        command_covariates(replace(seen, history_known=True, worked=seen.before))
    )


@pytest.mark.parametrize("kind", VOCABULARY, ids=lambda kind: kind.cause)
def test_mechanism_at_zero_is_identity(kind: type[Mechanism], seen: PushScene, base: AnalyticPush) -> None:
    still = with_values(kind, seen, *[0.0] * len(kind.quantities))
    assert not still.active
    assert np.array_equal(base.plus(still).change(seen), base.change(seen))


@pytest.mark.parametrize("kind", VOCABULARY, ids=lambda kind: kind.cause)
def test_mechanism_is_smooth_at_zero_in_every_quantity(
    kind: type[Mechanism], seen: PushScene, base: AnalyticPush
) -> None:
    plain = base.change(seen).astype(np.float64)
    for q in range(len(kind.quantities)):
        if kind.cause == "springback" and kind.quantities[q].name == "recovered_by_log_time":
            continue  # all scans follow after about the same time
        values = np.array(typical(kind)) * (np.arange(len(kind.quantities)) == q)
        small, half, back = (
            base.plus(with_values(kind, seen, *(share * values))).change(seen) - plain for share in (0.1, 0.05, -0.1)
        )
        size = np.linalg.norm(small)
        assert size > 1e-6
        assert np.linalg.norm(small - 2 * half) < 0.1 * size
        assert np.linalg.norm(small + back) < 0.2 * size


@pytest.mark.parametrize("kind", VOCABULARY, ids=lambda kind: kind.cause)
def test_mechanism_is_finite_with_unknown_covariates(
    kind: type[Mechanism], seen: PushScene, base: AnalyticPush
) -> None:
    gaps = {
        name: np.where(np.arange(len(seen)) == 1, np.nan, values) if name not in ("order", "reset_id") else values
        for name, values in seen.covariates.items()
    }
    some = base.plus(with_values(kind, seen, *typical(kind))).change(replace(seen, covariates=gaps))
    assert np.isfinite(some).all()


@pytest.mark.parametrize(
    ("cause", "without"),
    [("adhesion_lift", "retract_speed_m_s"), ("stiffness_drift", "t_start_s order temperature_c")],
)
def test_not_observable_without_recorded_covariate(cause: str, without: str, seen: PushScene) -> None:
    columns = {name: v for name, v in seen.covariates.items() if name not in without.split()}
    with pytest.raises(NotObservable, match=r"recorded"):
        KINDS[cause].reference_of(replace(seen, covariates=columns))


def test_work_hardening_requires_history(seen: PushScene) -> None:
    with pytest.raises(NotObservable, match="reset_id"):
        KINDS["work_hardening"].reference_of(replace(seen, history_known=False))
    with pytest.raises(NotObservable, match="hardly a push"):
        KINDS["work_hardening"].reference_of(replace(seen, worked=np.zeros_like(seen.worked)))


def test_backlash_requires_varied_headings(seen: PushScene) -> None:
    action = seen.action.copy()
    action[:, 2] = 0.7
    with pytest.raises(NotObservable, match="one direction"):
        KINDS["tool_backlash"].reference_of(replace(seen, action=action))


def test_volume_loss_reduces_rims(seen: PushScene, base: AnalyticPush) -> None:
    lossy = base.plus(with_values(KINDS["volume_loss"], seen, 0.5, 0.0))
    plain, less = base.change(seen), lossy.change(seen)
    sunk = np.maximum(-plain, 0).sum((1, 2))
    share = -(less - plain).sum((1, 2)) / sunk
    assert ((share > 0.3) & (share < 0.7)).all()


def test_work_hardening_affects_only_worked_places(seen: PushScene, base: AnalyticPush) -> None:
    worked = seen.worked.max((1, 2)) > 1e-3
    assert worked.any() and (~worked).any()
    plain = base.change(seen)
    there = (seen.worked > 2e-3) & (plain < -1e-3)
    for values in ((0.6, 0.0), (0.0, 0.6)):
        harder = base.plus(with_values(KINDS["work_hardening"], seen, *values)).change(seen)
        assert np.allclose(harder[~worked], plain[~worked], atol=1e-7)
        assert (harder[there] > plain[there]).mean() > 0.95


def test_hardening_lifts_only_compliant_arm(seen: PushScene, base: AnalyticPush) -> None:
    hard = with_values(KINDS["work_hardening"], seen, 0.0, 0.6)
    stiff = first_model(seen)
    worked = seen.worked.max((1, 2)) > 3e-3
    given, still = (touch(model.plus(hard), seen).pressed_m - touch(model, seen).pressed_m for model in (base, stiff))
    assert not still.any()
    assert given[worked].min() < -1e-4 and given.max() <= 1e-7


def test_backlash_shifts_reversed_motion_along_its_axis(seen: PushScene, base: AnalyticPush) -> None:
    east = np.flatnonzero(np.cos(seen.action[:, 2]) > 0.9)
    late = base.plus(with_values(KINDS["tool_backlash"], seen, 0.002, 0.0)).change(seen)
    plain = base.change(seen)
    moved = [centre(late[b], seen.along[b]) - centre(plain[b], seen.along[b]) for b in east]
    assert len(east) and max(moved) < -0.001


def centre(change: np.ndarray, along: np.ndarray) -> float:
    sunk = np.maximum(-change, 0)
    return float((sunk * along).sum() / sunk.sum())


@pytest.mark.parametrize(("by", "column"), [((5e-4, 0.0), "retract_speed_m_s"), ((0.0, 5e-4), "dwell_s")])
def test_adhesion_lift_grows_with_retract_speed_and_dwell(
    seen: PushScene, base: AnalyticPush, by: tuple[float, float], column: str
) -> None:
    lifted = base.plus(with_values(KINDS["adhesion_lift"], seen, *by)).change(seen) - base.change(seen)
    at_end = np.hypot(seen.along - seen.action[:, 3, None, None], seen.across) < 0.002
    rise = np.array([lift[there].mean() for lift, there in zip(lifted, at_end, strict=True)])
    order = np.argsort(seen.covariates[column])
    assert rise[order[0]] < 0 < rise[order[-1]]
    assert np.abs(lifted.sum((1, 2))).max() < 0.05 * np.abs(lifted).sum((1, 2)).max()


def test_slide_relaxes_pile_to_angle_of_repose_and_conserves_volume() -> None:
    pile = np.zeros((1, 21, 21), np.float32)
    pile[0, 10, 10] = 1.0
    left = relaxed(pile, np.float32(0.05), 4000)[0]
    steepest = max(np.abs(np.diff(left, axis=axis)).max() for axis in (0, 1))
    assert steepest < 0.06
    assert left.sum() == pytest.approx(1.0, rel=1e-4)
    assert np.allclose(left, left.T, atol=1e-5) and np.allclose(left, left[::-1], atol=1e-5)


def relaxed_once(height: np.ndarray, step_m: float) -> np.ndarray:
    """Reference: one iteration of ``relaxed`` over a whole map [H, W]."""
    after = height.copy()
    rows, columns = height.shape
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        from_ = (slice(0, rows - down), slice(max(-right, 0), columns - max(right, 0)))
        to = (slice(down, rows), slice(max(right, 0), columns - max(-right, 0)))
        fall = height[from_] - height[to]
        flow = 0.125 * np.sign(fall) * np.maximum(abs(fall) - step_m * np.hypot(down, right), 0)
        after[from_] -= flow
        after[to] += flow
    return after


@pytest.mark.parametrize("place", [(8, 9), (0, 0), (0, 13), (11, 0), (11, 13)])
def test_slide_kernel_matches_dense_reference(place: tuple[int, int]) -> None:
    expected = np.zeros((12, 14))
    expected[place] = 1.0
    expected[5, 6] = -0.4
    heights = expected[None].astype(np.float32)
    for sweeps in range(1, 12):
        expected = relaxed_once(expected, 0.05)
        assert np.allclose(relaxed(heights, np.float32(0.05), sweeps)[0], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("shares", "physical"), [((0.0, 1.0, 0.0), True), ((-0.1, 0.3, 0.7), True), ((0, 0, 0.3), False)]
)
def test_slide_shares_below_minimum_are_unphysical(shares: tuple[float, ...], physical: bool, seen: PushScene) -> None:
    assert with_values(KINDS["slope_slide"], seen, *shares).physical == physical


def test_slide_interpolates_between_angles() -> None:
    rng = np.random.default_rng(3)
    hills = cv2.GaussianBlur(rng.normal(size=(48, 48)), (0, 0), 3.0).astype(np.float32)
    hills = hills[None] * np.float32(0.004 / hills.std())

    def run_off(angle: float) -> np.ndarray:
        return relaxed(hills, np.float32(angle * 0.001), 40) - hills

    basis = np.stack([run_off(angle).ravel() for angle in (0.6, 1.1, 1.9)]).astype(float)
    for angle in (0.7, 0.85, 1.3, 1.6):
        expected = run_off(angle).ravel()
        shares, *_ = np.linalg.lstsq(basis.T, expected, rcond=None)
        assert np.square(expected - shares @ basis).sum() < 0.06 * np.square(expected).sum()
        assert 0.9 < shares.sum() < 1.15


def test_slide_leaves_flatter_slopes_unchanged() -> None:
    slope = np.tile(np.linspace(0, 1, 11, dtype=np.float32) * 0.4, (1, 11, 1))
    assert np.array_equal(relaxed(slope, np.float32(0.05), 10), slope)


def test_sinking_deepens_and_widens_only_the_end(seen: PushScene, base: AnalyticPush) -> None:
    assert not set(UNNAMED) & set(VOCABULARY)
    sinks = base.plus(with_values(Sinking, seen, 0.2))
    longer = seen.covariates["dwell_s"] > 1.2 * sinks.mechanisms[0].reference["dwell_s"]
    travels = seen.action[:, 3] > 0.012
    changed = touch(sinks, seen).pressed_m - touch(base, seen).pressed_m
    early = (seen.along < 0.3 * seen.action[:, 3, None, None]) & (changed != 0)
    assert abs(changed[travels][early[travels]]).max() < 0.1 * changed[travels].max()
    assert longer.sum() > 5 and np.median(changed[longer].max((1, 2))) > 5e-4 > 1e-6 > changed[longer].min()
    wider = (touch(sinks, seen).inside - touch(base, seen).inside).sum((1, 2))
    assert np.median(wider[longer]) > 1  # pixels


@pytest.mark.parametrize("sigma_px", [0.6, 1.9, 2.1, 5.5, 30.0])
def test_spread_matches_gaussian_filter_with_zero_border(sigma_px: float) -> None:
    maps = np.random.default_rng(0).normal(size=(3, 64, 48))
    expected = gaussian_filter(maps, (0, sigma_px, sigma_px), mode="constant", truncate=4)
    assert np.allclose(spread(maps, sigma_px), expected, atol=2e-4)


def test_spread_conserves_volume_away_from_edges() -> None:
    heap = np.zeros((1, 96, 96))
    heap[0, 48, 48] = 1.0
    assert spread(heap, 6.0).sum() == pytest.approx(1.0, abs=1e-5)
