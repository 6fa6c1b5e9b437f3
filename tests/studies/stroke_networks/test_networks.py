"""Networks of coverage: what they know before they learn, that mirrors do not deceive them, and that they learn."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from pentimento.dynamics.strokes.evaluation import predict_with, weighted_l1
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.training import TrainingConfig
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke
from studies.stroke_models.networks.coverage import (
    CoverageModel,
    PressRange,
    laid,
    measured_coverage,
    numbers_of,
    press_range,
)
from studies.stroke_models.networks.fit import (
    Setting,
    fit_param2stroke,
    fit_path_image_cnn,
    fit_refined,
    fit_trajectory_cnn,
    predicted,
)
from studies.stroke_models.networks.frame import crop_around
from studies.stroke_models.networks.param2stroke import Param2Stroke, shape_numbers
from studies.stroke_models.networks.path_image import PathImageCnn
from studies.stroke_models.networks.refined import RefinedTraj2Stroke
from studies.stroke_models.networks.stamp import fit_stamp
from studies.stroke_models.networks.trajectory_cnn import TrajectoryCnn
from studies.stroke_models.networks.unet import UNet
from tests.dynamics.strokes.conftest import TRUTH

MARGIN_M = 0.008
PRESS = PressRange(0.0, 3e-3)
CONFIG = TrainingConfig(12, 1000.0, MARGIN_M, 16, 6, 0.004, 2.0, 0.2, 0)


def untrained(samples: StrokeSamples) -> dict[str, CoverageModel]:
    crop = crop_around(samples.path, MARGIN_M, 1000.0, 8)
    return {
        "param2stroke": Param2Stroke(crop, PRESS),
        "cnn": TrajectoryCnn(crop, PRESS, samples.path.shape[1], False),
        "coordconv": TrajectoryCnn(crop, PRESS, samples.path.shape[1], True),
        "path_image": PathImageCnn(PRESS, MARGIN_M, 1000.0),
        "refined": RefinedTraj2Stroke(Traj2Stroke(TRUTH), MARGIN_M, 1000.0),
    }


def test_paper_and_paint_are_mixed_in_linear_light(made_by_truth: StrokeSamples) -> None:
    samples = made_by_truth
    nothing, everything = (torch.full_like(samples.valid, value) for value in (0.0, 1.0))
    torch.testing.assert_close(laid(nothing, samples), samples.before, atol=1e-5, rtol=0)
    torch.testing.assert_close(laid(everything, samples)[:, 0, 0], samples.color, atol=1e-5, rtol=0)
    half = torch.full_like(samples.valid, 0.5)
    again = measured_coverage(samples._replace(after=laid(half, samples)))
    torch.testing.assert_close(again, half, atol=1e-4, rtol=0)


def test_before_the_u_net_learns_it_changes_nothing(made_by_truth: StrokeSamples) -> None:
    model = untrained(made_by_truth)["refined"].eval()
    torch.testing.assert_close(predicted(model, made_by_truth), predict_with(TRUTH, made_by_truth), atol=1e-5, rtol=0)


def test_the_u_net_starts_at_zero_and_can_leave_it() -> None:
    torch.manual_seed(0)
    net, image = UNet(1), torch.rand(2, 1, 16, 24)
    assert net(image).abs().max() == 0
    net(image)[:, :8].sum().backward()
    slope = net.last.weight.grad
    assert slope is not None
    assert (slope.abs().amax((0, 2, 3)) > 0.05 * slope.abs().max()).float().mean() > 0.3  # not through its bias alone


@pytest.mark.parametrize("name", ["param2stroke", "cnn", "coordconv", "path_image", "refined"])
def test_a_stroke_seen_in_the_mirror_is_drawn_the_right_way_round(name: str) -> None:
    """A window with the stroke's x axis in its middle: to mirror the path is to flip the picture."""
    torch.manual_seed(1)
    t = torch.linspace(0, 1, 12)
    path = torch.stack([t, 0.01 + 0.03 * t, 0.02 + 0.02 * t * (1 - t) * (1 + t), -1e-3 * (1 + t), 0 * t], dim=-1)[None]
    mirrored = path.clone()
    mirrored[..., 2] = 0.04 - path[..., 2]
    white = torch.ones(1, 40, 50, 3)
    samples = StrokeSamples(
        path, torch.tensor([[0.0, 0.04]]), torch.tensor([1000.0]), white, white, white, torch.zeros(1, 3),
        torch.zeros(1, 40, 50, dtype=torch.bool), torch.ones(1, 40, 50), torch.zeros(1, dtype=torch.int64),
    )  # fmt: skip
    model = untrained(samples)[name].eval()
    for parameter in model.parameters():  # zero convolutions too
        if parameter.ndim > 1 and not parameter.any():
            torch.nn.init.normal_(parameter, std=0.1)
    if name == "refined":  # the robot's own offset is no part of what is mirrored
        model.base.offset_mm.data.zero_()  # type: ignore[union-attr, operator]
    with torch.no_grad():
        straight = model(samples._replace(path=mirrored))
        model.mirror = lambda strokes: -torch.ones(strokes)  # type: ignore[method-assign]
        seen_in_mirror = model(samples)
    assert straight.std() > 1e-3
    torch.testing.assert_close(seen_in_mirror, straight.flip(1), atol=1e-4, rtol=0)


def test_param2stroke_sees_length_bend_and_press(made_by_truth: StrokeSamples) -> None:
    t = torch.linspace(0, 1, 32)
    path = torch.zeros(1, 32, 5)
    path[0, :, 1], path[0, :, 2], path[0, :, 3] = 0.04 * t, -0.006 * 3 * t * (1 - t), -1.5e-3
    numbers = numbers_of(path, PRESS, torch.ones(1))
    # The chord is the x axis: units of 20 mm, and press about the middle of its range.
    torch.testing.assert_close(shape_numbers(numbers), torch.tensor([[2.0, -0.3, 0.0]]), atol=1e-5, rtol=0)
    other_way = shape_numbers(numbers_of(path, PRESS, -torch.ones(1)))
    torch.testing.assert_close(other_way, torch.tensor([[2.0, 0.3, 0.0]]), atol=1e-5, rtol=0)
    assert press_range(made_by_truth.path).low_m >= 0


Fit = Callable[[StrokeSamples, Setting], CoverageModel]
FITS: dict[str, Fit] = {
    "param2stroke": lambda samples, setting: fit_param2stroke(samples, setting, _quiet),
    "cnn": lambda samples, setting: fit_trajectory_cnn(samples, setting, False, _quiet),
    "coordconv": lambda samples, setting: fit_trajectory_cnn(samples, setting, True, _quiet),
    "path_image": lambda samples, setting: fit_path_image_cnn(samples, setting, _quiet),
}


@pytest.mark.parametrize("name", sorted(FITS))
def test_a_network_learns_more_than_blank_paper(name: str, made_by_truth: StrokeSamples) -> None:
    learnt = FITS[name](made_by_truth, Setting(made_by_truth.path, MARGIN_M, CONFIG))
    assert not learnt.training
    error, nothing = (
        float(weighted_l1(image, made_by_truth, 2.0))
        for image in (predicted(learnt, made_by_truth), made_by_truth.before)
    )
    assert error < 0.6 * nothing


def test_the_u_net_takes_up_what_the_base_leaves(made_by_truth: StrokeSamples) -> None:
    """A base that is too narrow by half: the U-Net behind it widens the stroke, and the base stays as it is."""
    narrow = Traj2Stroke(TRUTH)
    with torch.no_grad():
        narrow.beta_mm.mul_(0.5)
    before = {name: value.clone() for name, value in narrow.state_dict().items()}
    learnt = fit_refined(narrow, made_by_truth, Setting(made_by_truth.path, MARGIN_M, CONFIG), _quiet)
    held = narrow.parameters_si()
    error = weighted_l1(predicted(learnt, made_by_truth), made_by_truth, 2.0)
    assert error < 0.7 * weighted_l1(predict_with(held, made_by_truth), made_by_truth, 2.0)
    assert all(torch.equal(value, before[name]) for name, value in narrow.state_dict().items())


def test_a_stamp_is_the_mark_that_all_strokes_leave(made_by_truth: StrokeSamples) -> None:
    """Strokes of one shape, turned and moved: the stamp predicts them all; it fails where they differ."""

    def error_on(samples: StrokeSamples) -> float:
        def error(stamp: Callable[[StrokeSamples], Tensor]) -> float:
            return float(weighted_l1(laid(stamp(samples), samples), samples, 2.0))

        return error(fit_stamp(samples, MARGIN_M, 1000.0, error)) / float(weighted_l1(samples.before, samples, 2.0))

    one = made_by_truth.path[:1]
    angle = torch.linspace(0, 6, len(made_by_truth.path))
    away = one[..., 1:3] - one[:, :1, 1:3]
    turned = torch.stack(
        [
            angle.cos()[:, None] * away[..., 0] - angle.sin()[:, None] * away[..., 1],
            angle.sin()[:, None] * away[..., 0] + angle.cos()[:, None] * away[..., 1],
        ],
        dim=-1,
    )  # fmt: skip
    path = one.expand(len(angle), -1, -1).clone()
    path[..., 1:3] = turned - turned.mean(1, keepdim=True) + torch.tensor([0.04, 0.04])
    equal = made_by_truth._replace(path=path)
    # The truth's offset is the robot's: without it, all marks are equal in their own frames.
    pen = type(TRUTH)((0.9, 0.9), (0.0, 0.0), *(getattr(TRUTH, n) for n in _PEN))
    equal = equal._replace(after=predict_with(pen, equal))
    assert error_on(equal) < 0.25
    assert error_on(made_by_truth) > 2 * error_on(equal)


_PEN = ("thickness_per_press", "thickness_at_contact_m", "softness", "opacity")


def _quiet(name: str, value: float, step: int) -> None:
    """Curves are not looked at."""
