"""What param2deform is compared with: an analytic plough, and a U-Net in the scan's own frame."""

import dataclasses

import numpy as np
import pytest
import torch

from pentimento.contracts.pushes import example_table
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop
from studies.push_models import CONFIG
from studies.push_plough import Plough, above_start, fit_plough, footprint, ploughed
from studies.push_unet import CHANNELS, after_unet, fit_unet, in_map, on_map
from studies.stroke_models.networks.unet import UNet

CROP = Crop(64, 640.0, 0.03)
PLOUGH = Plough(9.0, 8.0, 2.2, 1.1, 0.15, 0.6, 4.0, 3.0)
LENGTH_M, DEPTH_M = torch.tensor([0.0, 0.01, 0.03]), torch.tensor([0.003, 0.006, 0.009])
LEVEL = torch.zeros(3, 64, 64)


@pytest.fixture(scope="module")
def samples() -> PushSamples:
    return load_pushes(example_table(24))[0]


def test_no_depth_no_change() -> None:
    change = footprint(PLOUGH, LEVEL, LENGTH_M, torch.zeros(3), CROP)
    assert torch.equal(change, torch.zeros_like(change))


def test_mirrored_push_leaves_mirrored_footprint() -> None:
    rough = 1e-3 * torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(0))
    change = footprint(PLOUGH, rough, LENGTH_M, DEPTH_M, CROP)
    mirrored = footprint(PLOUGH, rough.flip(1), LENGTH_M, DEPTH_M, CROP)
    torch.testing.assert_close(mirrored, change.flip(1), rtol=0, atol=1e-7)
    assert not torch.allclose(change, change.flip(1), atol=1e-5)


def test_volume_shares() -> None:
    """A share springs back, a share of the rest is heaped up beside and ahead of the groove, the rest is compacted."""
    dent = footprint(PLOUGH._replace(rebound=0.0, rim=0.0), LEVEL, LENGTH_M, DEPTH_M, CROP).sum((1, 2))
    assert (dent < 0).all()
    change = footprint(PLOUGH, LEVEL, LENGTH_M, DEPTH_M, CROP)
    torch.testing.assert_close(change.sum((1, 2)), (1 - 0.6) * (1 - 0.15) * dent, rtol=1e-4, atol=0)
    whole = footprint(PLOUGH._replace(rim=1.0), LEVEL, LENGTH_M, DEPTH_M, CROP)
    assert (whole.sum((1, 2)).abs() < 1e-4 * dent.abs()).all()
    assert whole.amax((1, 2)).gt(1e-4).all()


def test_rims_are_ahead_of_a_travelling_tool() -> None:
    change = footprint(PLOUGH, LEVEL, LENGTH_M, DEPTH_M, CROP)[2]
    x_m = CROP.places_m()[..., 0]
    raised = change.clamp(min=0)
    assert float((raised * x_m).sum() / raised.sum()) > 0.02


def test_fit_finds_the_plough_that_made_the_pushes(samples: PushSamples) -> None:
    seen = above_start(samples, CROP)
    made = seen._replace(change=footprint(PLOUGH, seen.state, seen.length_m, seen.depth_m, CROP))
    assert fit_plough(made, CROP) == pytest.approx(PLOUGH, rel=0.02)


def test_ploughed_scans_have_the_footprints(samples: PushSamples) -> None:
    """Of pushes along the pixels' rows, from pixels' corners, no sampling is needed."""
    crop = Crop(40, samples.pixels_per_m, 0.03)
    action = samples.action.copy()
    corner = samples.window_m[:, :2]
    action[:, :2] = corner + np.rint((action[:, :2] - corner) * samples.pixels_per_m) / samples.pixels_per_m
    action[:, 2] = 0.0
    straight = samples._replace(action=action)
    seen = above_start(straight, crop)
    there = above_start(straight._replace(after=ploughed(PLOUGH, straight, crop).numpy()), crop)
    change = footprint(PLOUGH, seen.state, seen.length_m, seen.depth_m, crop)
    assert there.known.float().mean() > 0.5
    torch.testing.assert_close(there.change[there.known], change[there.known], rtol=0, atol=1e-6)


def test_unet_has_as_many_weights_as_param2deform() -> None:
    unet, network = (
        sum(parameter.numel() for parameter in model.parameters())
        for model in (UNet(CHANNELS), Param2Deform(CROP, CONFIG.channels))
    )
    assert abs(unet / network - 1) < 0.1


def test_turned_squares_are_those_of_turned_scans(samples: PushSamples) -> None:
    """Mirrored at the vertical axis, and at the diagonal from top left to bottom right."""
    count = len(samples.before)
    x_min, _, x_max, y_max = samples.window_m.T
    x, y, theta, length, depth = samples.action.T
    across = np.stack([x_min + x_max - x, y, np.pi - theta, length, depth], axis=1)
    swapped = np.stack([x_min + y_max - y, y_max - (x - x_min), -np.pi / 2 - theta, length, depth], axis=1)
    squares = in_map(samples)
    for turn, action, flip, swap in (
        (lambda image: image[:, :, ::-1], across, [True, False], False),
        (lambda image: image.transpose(0, 2, 1), swapped, [False, False], True),
    ):
        images = {name: np.ascontiguousarray(turn(getattr(samples, name))) for name in ("before", "after", "known")}
        there = in_map(samples._replace(action=action, **images))
        here = squares.turned(torch.tensor([flip]).expand(count, -1), torch.full((count,), swap))
        for name, expected, found in zip(here._fields, here, there, strict=True):
            torch.testing.assert_close(found, expected, rtol=0, atol=1e-6, msg=name)


def test_changes_return_to_their_places(samples: PushSamples) -> None:
    squares = in_map(samples)
    covered = on_map(torch.ones_like(squares.change), samples).bool()
    change = torch.from_numpy(samples.after - samples.before)
    assert covered.float().mean() > 0.9
    assert torch.equal(on_map(squares.change, samples), torch.where(covered, change, 0.0))


def test_unet_learns(samples: PushSamples) -> None:
    assert np.array_equal(after_unet(UNet(CHANNELS), samples).numpy(), samples.before)
    network = fit_unet(samples, dataclasses.replace(CONFIG, epochs=12, batch=8))
    error = np.square(after_unet(network, samples).numpy() - samples.after).mean()
    assert error < 0.6 * np.square(samples.after - samples.before).mean()
