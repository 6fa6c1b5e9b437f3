"""Resolution and margin follow the width of the line and the windows of the table."""

import dataclasses

import numpy as np
import pyarrow as pa
import pytest
import torch

from pentimento.contracts.colour import to_uint8
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import image_shape, window_around
from pentimento.contracts.images import encode_png
from pentimento.dynamics.strokes.evaluation import fit_polyline, mean_iou, predict, predict_with, score_model
from pentimento.dynamics.strokes.resolution import RowExtent, Sampling, choose_sampling
from pentimento.dynamics.strokes.samples import load_samples, sampling_of
from pentimento.dynamics.strokes.training import TrainingConfig, split_by_action, train
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters
from tests.dynamics.strokes.conftest import stroke_row, table

PEN = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.1, 0.6e-4, 0.05, 0.9)
"""Half-widths of 0.07 to 0.15 mm where it is pressed by 0.1 to 0.9 mm."""


def extent(width_m: float, pixels_per_m: float, paper_m: float = 0.012, size_m: float = 0.03) -> RowExtent:
    """A straight horizontal line of one width with round ends."""
    ink_m2 = width_m * size_m + np.pi * width_m**2 / 4
    return RowExtent(size_m, ink_m2, pixels_per_m, (size_m, 0.0), (paper_m,) * 4)


@pytest.mark.parametrize(
    ("row", "pixels_per_m", "margin_m"),
    [
        (extent(0.0014, 2e3), 2e3, 0.012),  # a marker: what the photographs hold
        (extent(0.008, 2e3), 2e3, 0.012),  # a brush
        (extent(0.0003, 12e3, paper_m=7e-4), 12e3, 7e-4),  # a pen in narrow windows: no more paper than there is
        (extent(0.0003, 12e3), 12e3, 3e-3),  # a pen in wide windows: ten line widths
        (extent(0.008, 20e3), 20e3 / 4, 0.012),  # 1080 x 480 px of a fine camera: less than 200 x 200 are enough
        (extent(0.0003, 24e3, size_m=0.06), 24e3 / 2, 3e-3),  # a long line of a pen: no less than 3 px across it
        (extent(0.1, 2e3, paper_m=0.5, size_m=0.5), 2e3 / 5, 0.15),  # a roller: one and a half line widths
        (extent(0.0003, 2e3), 2e3, 3e-3),  # photographs that are too coarse stay as they are
    ],
)
def test_resolution_and_margin_follow_line_and_windows(row: RowExtent, pixels_per_m: float, margin_m: float) -> None:
    found = choose_sampling([row], "auto", "auto")
    assert (found.pixels_per_m, found.margin_m) == pytest.approx((pixels_per_m, margin_m))
    assert found.line_width_m == pytest.approx(row.ink_m2 / row.length_m, rel=0.3)


def test_numbers_of_the_settings_stand() -> None:
    assert choose_sampling([extent(0.0003, 12e3)], 2e3, 0.01) == Sampling(2e3, 0.01, pytest.approx(0.0003))
    assert choose_sampling([extent(0.0003, 12e3)], 2e3, "auto").margin_m == pytest.approx(3e-3)


def test_sentence_states_the_sampling_and_warns_of_coarse_photographs() -> None:
    fine, coarse = (choose_sampling([extent(0.0003, k)], "auto", "auto").sentence for k in (12e3, 2e3))
    assert "0.30 mm wide" in fine and "12 px/mm, 3.6 pixels across the line, with up to 3 mm" in fine
    assert "too coarse" not in fine and "too coarse" in coarse and "10 px/mm or more" in coarse


def test_without_ink_the_width_is_unknown() -> None:
    with pytest.raises(ContractError, match="None of the 2 strokes left ink"):
        choose_sampling([extent(0.0, 2e3)] * 2, "auto", "auto")


def pen_table(strokes: int, pixels_per_m: float) -> pa.Table:
    """Bent strokes of 4 to 10 mm by PEN on white paper, with windows of 1 mm of paper around them."""
    rng = np.random.default_rng(3)
    rows = []
    for action in range(strokes):
        s, angle, length = np.linspace(0, 1, 16), rng.uniform(-np.pi, np.pi), rng.uniform(4e-3, 10e-3)
        bend = rng.uniform(-2e-3, 2e-3) * 4 * s * (1 - s)
        x = 0.03 + np.cos(angle) * length * s - np.sin(angle) * bend
        y = 0.03 + np.sin(angle) * length * s + np.cos(angle) * bend
        path = np.column_stack([s, x, y, -rng.uniform(1e-4, 9e-4) * np.ones(16), 0 * s]).astype(np.float32)
        corner = np.floor(window_around(path, 1e-3)[:2] * pixels_per_m) / pixels_per_m
        side = np.ceil((window_around(path, 1e-3)[2:] - corner) * pixels_per_m) / pixels_per_m
        window = np.concatenate([corner, corner + side])
        white = np.full((*image_shape(window, pixels_per_m), 3), 255, np.uint8)
        row = stroke_row(path, white, white, action) | {"window_m": window.tolist()}
        blank = load_samples(table([row]), 16, pixels_per_m, 1.0)
        with torch.no_grad():
            after = to_uint8(predict(Traj2Stroke(PEN), blank)[0].numpy())
        rows.append(row | {"after": {"bytes": encode_png(after), "path": None}})
    return table(rows)


@pytest.fixture(scope="module")
def pen() -> pa.Table:
    return pen_table(40, 12e3)


def test_sampling_of_a_thin_pen_does_not_depend_on_the_order_of_rows(pen: pa.Table) -> None:
    found = sampling_of(pen, "auto", "auto")
    assert found.pixels_per_m == pytest.approx(12e3, rel=1e-3)
    assert 0.15e-3 < found.line_width_m < 0.3e-3
    assert 1e-3 <= found.margin_m < 1.2e-3
    assert sampling_of(pen.take(np.arange(40)[::-1]), "auto", "auto") == found
    chosen = load_samples(pen, 16, "auto", "auto")
    given = load_samples(pen, 16, found.pixels_per_m, found.margin_m)
    assert all(torch.equal(one, other) for one, other in zip(chosen, given, strict=True))


def test_model_of_a_thin_pen_beats_the_polyline_at_the_chosen_sampling(pen: pa.Table) -> None:
    config = TrainingConfig(16, "auto", "auto", 30, 8, 0.03, 2.0, 0.25, 0)
    found = sampling_of(pen, config.pixels_per_m, config.margin_m)
    training, held_out = split_by_action(load_samples(pen, 16, found.pixels_per_m, found.margin_m), 0.25, 0)
    model = train(training, config, lambda *_: None).parameters_si()
    half = found.line_width_m / 2
    polyline = fit_polyline(lambda pen: -mean_iou(predict_with(pen, training), training), half)
    assert 0.5 * half < polyline.thickness_at_contact_m < 2 * half
    assert model.thickness_per_press == pytest.approx(PEN.thickness_per_press, rel=0.2)
    assert score_model(model, held_out).iou > score_model(polyline, held_out).iou + 0.05


@pytest.mark.parametrize("field", ["pixels_per_m", "margin_m"])
def test_a_config_takes_auto_or_a_number_above_zero(field: str) -> None:
    config = TrainingConfig(16, "auto", "auto", 1, 8, 0.03, 2.0, 0.25, 0)
    assert getattr(dataclasses.replace(config, **{field: 2.0}), field) == 2.0
    with pytest.raises(ValueError, match=rf"^{field} is 0.0; it must be above 0"):
        dataclasses.replace(config, **{field: 0.0})
