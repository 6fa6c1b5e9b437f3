"""Scores of a push model on held-out scans, compared with the noise floor and trivial baselines; and pictures of
its predictions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from torch import Tensor

from pentimento.dynamics.pushes.measured import PushSamples
from pentimento.dynamics.pushes.pose import Crop, PoseSamples, height_errors, in_pose, slope_errors, to_canvas, to_pose
from pentimento.dynamics.pushes.push_model import PushModel

_VOXEL_M = 5e-3
"""Voxel side by which point clouds are thinned (thesis 7.3.4)."""
_BATCH = 64
"""Pushes in one forward pass."""
_FLOOR_SCORES = ("l_3d_mm2", "l_viz", "window_l_3d_mm2", "window_l_viz")
"""Scores that are divided by the noise floor."""
Array = NDArray[np.float64]
_LIGHT = np.array([-0.5, 0.5, 0.75]) / np.linalg.norm([-0.5, 0.5, 0.75])
"""Direction of the light, from the upper left: right, up, towards the eye."""
_SLOPE_GAIN = 1.5
"""Slopes are exaggerated by this factor."""
_GAP_PX = 3
"""Between pictures."""
_MAX_ERROR_M = 2e-3
"""Error, up or down, that is shown in full colour."""


@dataclass(frozen=True)
class PushScores:
    """Means over pushes. The crop is the square of the constant pose, the window is the whole scan."""

    l_3d_mm2: float
    """Mean squared error of height over the crop (thesis 7.1)."""
    l_viz: float
    """Mean squared error of the spatial gradient over the crop, 1 (thesis 7.2)."""
    window_l_3d_mm2: float
    """Likewise over the window."""
    window_l_viz: float
    """Likewise over the window."""
    chamfer_mm: float
    """Chamfer distance of the crop's points, thinned by voxels of 5 mm."""
    emd_mm: float
    """Earth mover's distance of the same points."""


def predict(model: PushModel, samples: PushSamples, context: int = 0) -> Tensor:
    """Heights [N, H, W] after each push, over the whole window, metres."""
    before, window, action = _tensors(samples)
    contexts = torch.full((len(action),), context)
    parts = torch.split(torch.arange(len(action)), _BATCH)
    with torch.no_grad():
        return torch.cat([model.after(before[i], window[i], action[i], contexts[i]) for i in parts])


def unchanged(samples: PushSamples) -> Tensor:
    """Trivial baseline: the surface does not change."""
    return torch.from_numpy(samples.before)


def mean_footprint(training: PushSamples, samples: PushSamples, crop: Crop) -> Tensor:
    """Trivial baseline: every push leaves the mean footprint of the training pushes, in its pose."""
    seen = in_pose(training, crop)
    weight = seen.known.float()
    footprint = (seen.change * weight).sum(0) / weight.sum(0).clamp(min=1.0)
    before, window, action = _tensors(samples)
    shape = (before.shape[1], before.shape[2])
    return before + to_canvas(footprint.expand(len(action), -1, -1), window, action, shape=shape, crop=crop)


def score(predicted: Tensor, samples: PushSamples, crop: Crop) -> PushScores:
    """Scores of predicted heights [N, H, W], metres."""
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
    """Noise floor: the variance of the changes of repeated actions, which no model can predict."""

    l_3d_mm2: float
    l_viz: float
    window_l_3d_mm2: float
    window_l_viz: float
    actions: int
    """Number of repeated actions."""


def floor(samples: PushSamples, crop: Crop) -> Floor | None:
    """Unbiased variance of the changes among rows that repeat an action; None without repeats.

    Like every score, it contains the noise of both scans.
    """
    seen = in_pose(samples, crop)
    window = _tensors(samples).window_m
    change = torch.from_numpy(samples.after) - torch.from_numpy(samples.before)
    known = torch.from_numpy(samples.known)
    variances: list[tuple[float, ...]] = []
    for action in np.unique(samples.action_id):
        index = torch.from_numpy(np.flatnonzero(samples.action_id == action))
        if len(index) > 1 and _one_window(window[index]):
            pose = _scatter(seen.change[index], seen.known[index], crop.pixels_per_m)
            variances.append((*pose, *_scatter(change[index], known[index], samples.pixels_per_m)))
    if not variances:
        return None
    height, slope, window_height, window_slope = (float(value) for value in np.mean(variances, axis=0))
    return Floor(height, slope, window_height, window_slope, len(variances))


def scores(
    model: PushModel, training: PushSamples, held_out: PushSamples, *, all_samples: PushSamples, context: int = 0
) -> dict[str, Any]:
    """Content of metrics.json: held-out scores of the model and of trivial baselines, and the noise floor of all
    repeated actions.

    The ratio to the floor is computed on the repeated actions among the held-out ones: noise grows with the moved
    volume, so a floor of small pushes does not apply to large ones.
    """
    crop = model.facts.crop
    predicted = predict(model, held_out, context)
    model_score = score(predicted, held_out, crop)
    metrics: dict[str, Any] = {
        "held_out": {
            "model": asdict(model_score),
            "mean_footprint": asdict(score(mean_footprint(training, held_out, crop), held_out, crop)),
            "unchanged": asdict(score(unchanged(held_out), held_out, crop)),
        }
    }
    noise_floor = floor(all_samples, crop)
    if noise_floor is not None:
        metrics["floor"] = asdict(noise_floor)
    again = repeated(held_out)
    noise_floor = floor(held_out, crop)
    if noise_floor is not None:
        model_score = score(predicted[torch.from_numpy(again)], held_out.pick(again), crop)
        metrics["held_out_repeats"] = {
            "model": asdict(model_score),
            "floor": asdict(noise_floor),
            "over_floor": {name: getattr(model_score, name) / getattr(noise_floor, name) for name in _FLOOR_SCORES},
        }
    return metrics


def repeated(samples: PushSamples) -> NDArray[np.bool_]:
    """[N] which rows repeat the action of another row."""
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


class _Tensors(NamedTuple):
    """What a model sees of N pushes; see ``PushSamples``."""

    before: Tensor
    window_m: Tensor
    action: Tensor


def _tensors(samples: PushSamples) -> _Tensors:
    return _Tensors(
        torch.from_numpy(samples.before),
        torch.from_numpy(samples.window_m.astype(np.float32)),
        torch.from_numpy(samples.action.astype(np.float32)),
    )


def cloud(height_m: NDArray[Any], known: NDArray[np.bool_], pixels_per_m: float) -> Array:
    """Points [P, 3] in metres of the known pixels of a height map [H, W]; x along columns, y up."""
    row, column = np.nonzero(known)
    return np.stack([column / pixels_per_m, -row / pixels_per_m, height_m[row, column]], axis=1).astype(np.float64)


def thinned(points: Array, voxel_m: float, center_m: Array) -> Array:
    """One point for each occupied voxel: the mean of its points.

    ``center_m`` [3] is the centre of a voxel. With a centre at the height of the surface, noise does not split the
    surface into two layers.
    """
    _, index = np.unique(np.floor((points - center_m) / voxel_m + 0.5).astype(np.int64), axis=0, return_inverse=True)
    index = index.reshape(-1)
    count = np.bincount(index)
    return np.stack([np.bincount(index, points[:, axis]) / count for axis in range(3)], axis=1)


def chamfer(one: Array, other: Array) -> float:
    """Mean distance from each point to the nearest point of the other cloud, summed over both directions, metres."""
    there, back = cKDTree(other).query(one)[0], cKDTree(one).query(other)[0]
    return float(there.mean() + back.mean())


def earth_movers(one: Array, other: Array, seed: int = 0) -> float:
    """Mean distance of the optimal assignment of points, metres; the larger cloud is subsampled to the smaller one's
    size."""
    rng = np.random.default_rng(seed)
    size = min(len(one), len(other))
    one, other = (c if len(c) == size else c[np.sort(rng.permutation(len(c))[:size])] for c in (one, other))
    distances = np.linalg.norm(one[:, None] - other[None], axis=2)
    return float(distances[linear_sum_assignment(distances)].mean())


def hillshade(height_m: NDArray[Any], pixels_per_m: float) -> NDArray[np.uint8]:
    """Grey uint8 [H, W] of heights [H, W] lit from the upper left; row 0 is the top."""
    down, across = np.gradient(np.asarray(height_m, dtype=np.float64) * pixels_per_m * _SLOPE_GAIN)
    # A surface that rises to the right leans to the left; one that rises down the image leans up it.
    normal = np.stack([-across, down, np.ones_like(down)], axis=-1)
    lit = normal @ _LIGHT / np.linalg.norm(normal, axis=-1)
    return np.asarray(np.rint(255 * np.clip(lit, 0.0, 1.0)), dtype=np.uint8)


def comparison(
    before_m: NDArray[Any],
    measured_m: NDArray[Any],
    predicted_m: NDArray[Any],
    *,
    known: NDArray[np.bool_],
    pixels_per_m: float,
) -> NDArray[np.uint8]:
    """RGB uint8 picture with a row for each of [N, H, W] pushes: before, measured, predicted, error (red: predicted too
    high)."""
    rows = []
    for before, measured, predicted, seen in zip(before_m, measured_m, predicted_m, known, strict=True):
        shaded = [_rgb(hillshade(height, pixels_per_m)) for height in (before, measured, predicted)]
        rows.append(_beside([*shaded, _signed(np.where(seen, predicted - measured, 0.0))], axis=1))
    return _beside(rows, axis=0)


def _rgb(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.repeat(grey[..., None], 3, axis=-1)


def _signed(error_m: NDArray[Any]) -> NDArray[np.uint8]:
    share = np.clip(error_m / _MAX_ERROR_M, -1.0, 1.0)[..., None]
    red, blue = np.array([178.0, 24.0, 43.0]), np.array([33.0, 102.0, 172.0])
    full = np.where(share > 0, red, blue)
    return np.asarray(np.rint(255.0 + np.abs(share) * (full - 255.0)), dtype=np.uint8)


def _beside(pictures: Sequence[NDArray[np.uint8]], axis: int) -> NDArray[np.uint8]:
    shape = list(pictures[0].shape)
    shape[axis] = _GAP_PX
    gap = np.full(shape, 255, dtype=np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)][1:]
    return np.concatenate(parts, axis=axis)
