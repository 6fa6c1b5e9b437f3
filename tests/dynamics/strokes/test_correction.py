"""The learned correction: symmetric, blind to place and heading, exact through its file, and only where it helps."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.strokes.correction import MarkCorrection
from pentimento.dynamics.strokes.extended import (
    MeasuredStrokes,
    base_model,
    model_files,
    predict_extended,
    predict_strokes,
    read_stroke_model,
)
from pentimento.dynamics.strokes.fit_correction import fit_correction
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.simulation import StrokeContext, final_mark
from pentimento.dynamics.strokes.traj2stroke import Mark, Traj2Stroke
from tests.dynamics.strokes.conftest import TRUTH
from tests.dynamics.strokes.test_joint import CONFIG

SWELLING = 0.4
"""Log of the radius at the start of a stroke over that at its end."""


@pytest.fixture(scope="module")
def swollen(made_by_truth: StrokeSamples) -> MeasuredStrokes:
    """48 strokes of TRUTH, thicker towards their starts; every shape is drawn twice, as actions of their own."""
    twice = torch.arange(48) % 24
    samples = made_by_truth.pick(twice)._replace(action=torch.arange(48))
    strokes = MeasuredStrokes(samples, {})
    after = predict_extended(Traj2Stroke(TRUTH).requires_grad_(False), [], strokes, _swell)
    return strokes._replace(samples=samples._replace(after=after))


def _swell(mark: Mark, path: torch.Tensor) -> Mark:
    along = torch.linspace(1, 0, mark.radius_m.shape[-1])
    return mark._replace(radius_m=mark.radius_m * (SWELLING * along).exp())


def some_correction(*, turned: bool) -> MarkCorrection:
    """With random weights and units that are no round numbers."""
    torch.manual_seed(3)
    correction = MarkCorrection(half_width_m=1.7e-3, press_m=1.1e-3, turned=turned, share=0.6).double()
    for parameter in correction.parameters():
        torch.nn.init.normal_(parameter, std=0.5)
    return correction.requires_grad_(False)


def some_paths() -> torch.Tensor:
    """[5, 12, 5], bent, pressed unevenly and turned."""
    rng = np.random.default_rng(1)
    t = np.linspace(0, 1, 12)
    bend, length = rng.uniform(-0.01, 0.01, (5, 1)), rng.uniform(0.01, 0.04, (5, 1))
    x, y = length * t, bend * t * (1 - t) + 2e-3 * np.sin(5 * t)
    z, yaw = -rng.uniform(1e-3, 2e-3, (5, 1)) * (1 + t), rng.uniform(-1, 1, (5, 1)) + 0 * t
    return torch.tensor(np.stack([t + 0 * x, x, y, z, yaw], axis=-1))


def corrected(correction: MarkCorrection, path: torch.Tensor) -> Mark:
    return correction(Traj2Stroke(replace(TRUTH, scale=(1.0, 1.0), offset_m=(0.0, 0.0))).double()(path), path)


def test_untrained_it_changes_nothing() -> None:
    path = some_paths()
    plain = Traj2Stroke(TRUTH).double()(path)
    same = MarkCorrection(half_width_m=2e-3, press_m=1e-3, turned=True).double()(plain, path)
    for before, after in zip(plain, same, strict=True):
        torch.testing.assert_close(after, before)


@pytest.mark.parametrize("turned", [False, True])
def test_a_mirrored_stroke_gets_the_mirrored_correction(turned: bool) -> None:
    path, flip = some_paths(), torch.tensor([1.0, 1.0, -1.0, 1.0, -1.0]).double()
    one, other = (corrected(some_correction(turned=turned), p) for p in (path, path * flip))
    torch.testing.assert_close(other.points_m, one.points_m * flip[1:3])
    for before, after in zip(one[1:], other[1:], strict=True):
        torch.testing.assert_close(after, before)
    assert (one.points_m - path[..., 1:3]).norm(dim=-1).max() > 1e-4


@pytest.mark.parametrize("turned", [False, True])
def test_place_and_heading_do_not_matter(turned: bool) -> None:
    """A stroke that is moved and turned, with its tool, gets the same correction, moved and turned."""
    path, angle, shift = some_paths(), 0.8, torch.tensor([0.03, -0.05]).double()
    turn = torch.tensor([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    moved = path.clone()
    moved[..., 1:3] = path[..., 1:3] @ turn + shift
    moved[..., 4] += angle
    one, other = (corrected(some_correction(turned=turned), p) for p in (path, moved))
    torch.testing.assert_close(other.points_m, one.points_m @ turn + shift)
    for before, after in zip(one[1:], other[1:], strict=True):
        torch.testing.assert_close(after, before)


def test_gradients_agree_with_finite_differences() -> None:
    correction = some_correction(turned=True)

    def flat(path: torch.Tensor) -> torch.Tensor:
        mark = corrected(correction, path)
        return torch.cat([mark.points_m.flatten(), mark.radius_m.flatten(), mark.density.flatten()])

    assert torch.autograd.gradcheck(flat, [some_paths()[:1].requires_grad_()], eps=1e-7, atol=1e-5, rtol=1e-3)


def test_a_point_that_does_not_move_has_a_finite_correction() -> None:
    path = some_paths()
    path[:, 1:, 1:3] = path[:, :1, 1:3]
    assert all(torch.isfinite(field).all() for field in corrected(some_correction(turned=True), path))


def test_it_finds_an_effect_of_geometry_on_other_strokes(swollen: MeasuredStrokes) -> None:
    fit = fit_correction(base_model(TRUTH), swollen, config=CONFIG, log=lambda *_: None)
    assert fit.share > 0 and fit.model.correction is not None
    assert fit.held_out_l1[1] < 0.6 * fit.held_out_l1[0]
    context = StrokeContext(swollen.samples.path[:, None], {})
    before = final_mark(fit.model.mark(), (), context).radius_m
    change = (final_mark(fit.model.mark(), (), context, fit.model.correction).radius_m / before).log().mean((0, 1))
    assert float(change[1] - change[-2]) == pytest.approx(SWELLING * 9 / 11, abs=0.12)


def test_where_nothing_is_left_there_is_none(swollen: MeasuredStrokes) -> None:
    """Noise that no geometry predicts, and strokes too few to tell."""
    noise = 0.02 * torch.randn(swollen.samples.after.shape, generator=torch.Generator().manual_seed(0))
    model = base_model(TRUTH)
    noisy = (predict_strokes(model, swollen) + noise).clamp(0, 1)
    pure = swollen._replace(samples=swollen.samples._replace(after=noisy))
    few = swollen.pick(torch.arange(30))
    for strokes in (pure, few):
        fit = fit_correction(model, strokes, config=CONFIG, log=lambda *_: None)
        assert (fit.share, fit.model, fit.held_out_l1[0]) == (0.0, model, fit.held_out_l1[1])


def test_it_survives_its_file(swollen: MeasuredStrokes, tmp_path: Path) -> None:
    model = replace(base_model(TRUTH), correction=some_correction(turned=False).float())
    for name, content in model_files(model).items():
        (tmp_path / name).write_text(json.dumps(content))
    again = read_stroke_model(tmp_path)
    assert torch.equal(predict_strokes(again, swollen), predict_strokes(model, swollen))
    assert not torch.equal(predict_strokes(again, swollen), predict_strokes(base_model(TRUTH), swollen))


@pytest.mark.parametrize("change", [{"mean": [0.0]}, {"share": None}, {"biases": [[0.0]] * 3}, {"more": 1}])
def test_a_damaged_file_is_a_sentence(change: dict[str, object], tmp_path: Path) -> None:
    model = replace(base_model(TRUTH), correction=some_correction(turned=False).float())
    for name, content in model_files(model).items():
        (tmp_path / name).write_text(json.dumps(content | change if name == "correction.json" else content))
    with pytest.raises(ContractError, match=r"correction\.json .*make it with the stage diagnose_gap"):
        read_stroke_model(tmp_path)
