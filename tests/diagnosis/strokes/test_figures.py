"""Figures of a diagnosis: maps put residuals at their places, and every figure can be drawn."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pentimento.diagnosis import figures
from pentimento.diagnosis.experiment_design import Aliasing, detectable
from pentimento.diagnosis.residual_structure import mode_strength
from pentimento.diagnosis.strokes import report
from pentimento.diagnosis.strokes.measured import Measured, covariates_shown
from pentimento.diagnosis.strokes.report import canvas_map, places_known, stroke_map
from pentimento.diagnosis.temporal_drift import TemporalDrift
from tests.diagnosis.strokes.conftest import Written


def drawn(png: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(image)


@pytest.mark.parametrize(
    "draw",
    [
        lambda w: figures.leave_one_out(w.result),
        lambda w: report.strokes(w.result, w.screening),
        lambda w: figures.mode_heat(w.screening, {("width", "press_m")}),
        lambda w: figures.dependence(w.screening),
        lambda w: figures.drift_curve(TemporalDrift("width", 0.001, 1e-5, 1e-5, np.sin(np.arange(60) / 4))),
        lambda w: figures.aliasing_heat(w.screening.aliasing, ["ink_depletion"]),
        lambda w: report.proposal_lines(w.proposal, w.screening),
    ],
    ids=["leave_one_out", "strokes", "modes", "dependence", "temporal_drift", "aliasing", "next actions"],
)
def test_figures_are_not_blank_and_reproducible(written: Written, draw: Callable[[Written], bytes]) -> None:
    first = draw(written)
    image = drawn(first)
    assert min(image.shape[:2]) > 300 and image.std() > 5
    assert draw(written) == first


def test_canvas_map_shows_a_residual_at_its_place(written: Written) -> None:
    """One stroke's window is too bright."""
    measured = written.measured
    residual = np.where(measured.samples.valid.numpy() > 0, 0.0, np.nan)
    residual[3] += 0.2
    found = canvas_map(residual, measured)
    left, right, bottom, top = found.extent
    rows, columns = np.nonzero(found.worst > 0.1)
    x = (left + (columns.mean() + 0.5) / found.worst.shape[1] * (right - left)) / 1e3
    y = (top - (rows.mean() + 0.5) / found.worst.shape[0] * (top - bottom)) / 1e3
    height, width = measured.samples.valid[3].shape
    k = float(measured.samples.pixels_per_m[3])
    corner = measured.samples.top_left_m[3].numpy()
    assert (x, y) == pytest.approx((corner[0] + width / k / 2, corner[1] - height / k / 2), abs=0.003)
    assert np.nanmax(found.mean) <= 0.2 + 1e-9 and np.nanmin(found.mean) >= 0


def test_straightened_strokes_agree_on_start_and_end(written: Written) -> None:
    """A bright disc at every stroke's end lies at 1 along and 0 across, for any bend."""
    measured = written.measured
    residual = np.where(measured.samples.valid.numpy() > 0, 0.0, np.nan)
    ends = measured.samples.view.to_pixels(measured.samples.path[..., 1:3])[:, -1].numpy()
    for b, (column, row) in enumerate(ends):
        y, x = np.mgrid[: residual.shape[1], : residual.shape[2]]
        residual[b][np.hypot(x - column, y - row) < 3] = 0.3
    found = stroke_map(residual, measured)
    at = np.argwhere(found.mean > 0.25).mean(0)
    left, right, bottom, top = found.extent
    assert left + (at[1] + 0.5) / found.mean.shape[1] * (right - left) == pytest.approx(1.0, abs=0.08)
    assert top - (at[0] + 0.5) / found.mean.shape[0] * (top - bottom) == pytest.approx(0.0, abs=0.5)


def test_worst_residual_keeps_its_sign(written: Written) -> None:
    measured = written.measured
    residual = np.where(measured.samples.valid.numpy() > 0, 0.01, np.nan)
    residual[5] *= -30
    assert np.nanmin(stroke_map(residual, measured).worst) == pytest.approx(-0.3, abs=1e-6)


def test_strokes_in_their_own_frame_have_no_place(written: Written) -> None:
    measured = written.measured
    path = measured.samples.path.clone()
    path[..., 1:3] -= path[:, :1, 1:3]
    assert places_known(measured)
    assert not places_known(replace(measured, samples=measured.samples._replace(path=path)))


def test_strength_is_the_root_of_n_times_the_correlation() -> None:
    rng = np.random.default_rng(0)
    y = rng.normal(size=(50, 1))
    x = 0.5 * np.clip(y[:, 0], -4, 4) + rng.normal(size=50)
    expected = abs(np.corrcoef(x, np.clip(y[:, 0], -4, 4))[0, 1]) * np.sqrt(50)
    assert mode_strength(y, {"x": x})[0, 0] >= expected - 1e-9
    even = np.abs(x)  # of a symmetric covariate only the square shows it
    assert mode_strength(even[:, None], {"x": x})[0, 0] > 2 * abs(np.corrcoef(x, even)[0, 1]) * np.sqrt(50)


def test_twice_the_strokes_detect_half_the_effect(written: Written) -> None:
    """The detectable share falls as 1 / n: doubling every action doubles all information."""
    from pentimento.diagnosis.gauss_newton import Statistics
    from pentimento.diagnosis.strokes.aliasing import columns_of
    from pentimento.diagnosis.strokes.jacobian import linearise

    full = written.screening.full
    statistics = linearise(full, written.measured)
    twice = Statistics(*(np.concatenate([values, values]) for values in statistics))
    once_found, twice_found = (detectable(s, columns_of(full)) for s in (statistics, twice))
    for cause, smallest in once_found.items():
        assert twice_found[cause] == pytest.approx(smallest / 2, rel=0.05)


def test_constant_or_incomplete_covariates_are_not_shown(written: Written) -> None:
    measured: Measured = replace(
        written.measured,
        covariates=written.measured.covariates | {"constant": np.ones(56), "gaps": np.full(56, np.nan)},
    )
    assert not {"constant", "gaps"} & set(covariates_shown(measured))
    assert "press_m" in covariates_shown(measured)


def test_aliasing_heat_draws_hidden_causes_as_holes() -> None:
    cosine = np.array([[1.0, np.nan], [np.nan, np.nan]])
    assert drawn(figures.aliasing_heat(Aliasing(("a", "b"), cosine), [])).std() > 2


def test_stroke_sheet_shows_the_test_split(written: Written) -> None:
    screening = written.screening
    assert len(screening.test) == len(written.result.splits.test)
    assert drawn(report.strokes(written.result, screening, shown=1)).shape[0] > 150
