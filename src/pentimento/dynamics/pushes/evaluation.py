"""How well a push model foretells scans, beside what repeats say is possible and what is trivial."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.dynamics.pushes.clouds import chamfer, cloud, earth_movers, thinned
from pentimento.dynamics.pushes.losses import height_errors, slope_errors
from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.pose import Crop, to_canvas, to_pose
from pentimento.dynamics.pushes.posed_samples import PoseSamples, in_pose
from pentimento.dynamics.pushes.push_model import PushModel

_VOXEL_M = 5e-3
_AT_ONCE = 64
_OF_THE_FLOOR = ("l_3d_mm2", "l_viz", "window_l_3d_mm2", "window_l_viz")


@dataclass(frozen=True)
class PushScores:
    """Means over pushes. The crop is the square of the constant pose, the window the whole scan."""

    l_3d_mm2: float
    """Mean squared error of height over the crop (thesis 7.1)."""
    l_viz: float
    """Mean squared error of the spatial gradient over the crop, 1 (thesis 7.2)."""
    window_l_3d_mm2: float
    """Likewise over the window."""
    window_l_viz: float
    """Likewise over the window."""
    chamfer_mm: float
    """Of the crop's points, thinned by voxels of 5 mm."""
    emd_mm: float
    """Earth Mover's Distance of the same."""


def predict(model: PushModel, samples: PushSamples, context: int = 0) -> Tensor:
    """Heights [N, H, W] after each push, over the whole window."""
    before, window, action = _tensors(samples)
    contexts = torch.full((len(action),), context)
    parts = torch.split(torch.arange(len(action)), _AT_ONCE)
    with torch.no_grad():
        return torch.cat([model.after(before[i], window[i], action[i], contexts[i]) for i in parts])


def unchanged(samples: PushSamples) -> Tensor:
    """The trivial prediction: nothing happens."""
    return torch.from_numpy(samples.before)


def mean_footprint(training: PushSamples, samples: PushSamples, crop: Crop) -> Tensor:
    """The next: every push leaves the mean of all training pushes, where it is."""
    seen = in_pose(training, crop)
    weight = seen.known.float()
    footprint = (seen.change * weight).sum(0) / weight.sum(0).clamp(min=1.0)
    before, window, action = _tensors(samples)
    shape = (before.shape[1], before.shape[2])
    return before + to_canvas(footprint.expand(len(action), -1, -1), window, action, shape, crop)


def score(predicted: Tensor, samples: PushSamples, crop: Crop) -> PushScores:
    """Scores of predicted heights [N, H, W]."""
    known = torch.from_numpy(samples.known)
    error = predicted - torch.from_numpy(samples.after)
    _, window, action = _tensors(samples)
    seen = in_pose(samples, crop)
    cropped = to_pose(error, window, action, crop)
    truth = seen.state + seen.change
    clouds = [_clouds(truth[i] + cropped[i], truth[i], seen.known[i], crop) for i in range(len(action))]
    return PushScores(
        l_3d_mm2=float(height_errors(cropped, seen.known).mean()),
        l_viz=float(slope_errors(cropped, seen.known, crop.pixels_per_m).mean()),
        window_l_3d_mm2=float(height_errors(error, known).mean()),
        window_l_viz=float(slope_errors(error, known, samples.pixels_per_m).mean()),
        chamfer_mm=1e3 * float(np.mean([pair[0] for pair in clouds])),
        emd_mm=1e3 * float(np.mean([pair[1] for pair in clouds])),
    )


@dataclass(frozen=True)
class Floor:
    """What no model can beat that does not foresee noise: how far the changes of repeated actions scatter."""

    l_3d_mm2: float
    l_viz: float
    window_l_3d_mm2: float
    window_l_viz: float
    actions: int
    """That were repeated."""


def floor(samples: PushSamples, crop: Crop) -> Floor | None:
    """From rows that repeat an action: the variance of their changes, unbiased; None without any repeat.

    It holds the noise of both scans, as every score does.
    """
    seen = in_pose(samples, crop)
    _, window, _ = _tensors(samples)
    change = torch.from_numpy(samples.after) - torch.from_numpy(samples.before)
    known = torch.from_numpy(samples.known)
    found: list[tuple[float, ...]] = []
    for action in np.unique(samples.action_id):
        index = torch.from_numpy(np.flatnonzero(samples.action_id == action))
        if len(index) > 1 and _one_window(window[index]):
            pose = _scatter(seen.change[index], seen.known[index], crop.pixels_per_m)
            found.append((*pose, *_scatter(change[index], known[index], samples.pixels_per_m)))
    if not found:
        return None
    height, slope, window_height, window_slope = (float(value) for value in np.mean(found, axis=0))
    return Floor(height, slope, window_height, window_slope, len(found))


def scores(
    model: PushModel, training: PushSamples, held_out: PushSamples, everything: PushSamples, context: int = 0
) -> dict[str, Any]:
    """metrics.json of a model: held-out scores of it and of what is trivial, and the floor of all repeated actions.

    How far it is above the floor is said of the same pushes, the repeated actions among the held-out ones: noise grows
    with what a push moves, so that a floor of small pushes is none for large ones.
    """
    crop = model.facts.crop
    predicted = predict(model, held_out, context)
    own = score(predicted, held_out, crop)
    found: dict[str, Any] = {
        "held_out": {
            "model": asdict(own),
            "mean_footprint": asdict(score(mean_footprint(training, held_out, crop), held_out, crop)),
            "unchanged": asdict(score(unchanged(held_out), held_out, crop)),
        }
    }
    lowest = floor(everything, crop)
    if lowest is not None:
        found["floor"] = asdict(lowest)
    again = repeated(held_out)
    lowest = floor(held_out, crop)
    if lowest is not None:
        own = score(predicted[torch.from_numpy(again)], held_out.pick(again), crop)
        found["held_out_repeats"] = {
            "model": asdict(own),
            "floor": asdict(lowest),
            "over_floor": {name: getattr(own, name) / getattr(lowest, name) for name in _OF_THE_FLOOR},
        }
    return found


def repeated(samples: PushSamples) -> NDArray[np.bool_]:
    """[N] which rows repeat an action of another row."""
    _, index, times = np.unique(samples.action_id, return_inverse=True, return_counts=True)
    return np.asarray(times[index] > 1)


def pose_error(model: PushModel, samples: PoseSamples) -> float:
    """L_3D in the crop, mm²."""
    with torch.no_grad():
        change = model.change(samples.state, samples.length_m, samples.depth_m, samples.context).mean(0)
    return float(height_errors(change - samples.change, samples.known).mean())


def _scatter(change: Tensor, known: Tensor, pixels_per_m: float) -> tuple[float, float]:
    """Variances (height in mm², gradient) of the changes [R, H, W] about their mean, where all are known."""
    difference = change - change.mean(0)
    everywhere = known.all(0).expand_as(known)
    unbiased = len(change) / (len(change) - 1)
    return (
        unbiased * float(height_errors(difference, everywhere).mean()),
        unbiased * float(slope_errors(difference, everywhere, pixels_per_m).mean()),
    )


def _one_window(window: Tensor) -> bool:
    return bool((window - window[:1]).abs().max() < 1e-5)


def _clouds(predicted: Tensor, truth: Tensor, known: Tensor, crop: Crop) -> tuple[float, float]:
    mask = known.numpy()
    dense = [cloud(height.numpy(), mask, crop.pixels_per_m) for height in (predicted, truth)]
    one, other = (thinned(points, _VOXEL_M, np.median(dense[1], axis=0)) for points in dense)
    return chamfer(one, other), earth_movers(one, other)


def _tensors(samples: PushSamples) -> tuple[Tensor, Tensor, Tensor]:
    return (
        torch.from_numpy(samples.before),
        torch.from_numpy(samples.window_m.astype(np.float32)),
        torch.from_numpy(samples.action.astype(np.float32)),
    )
