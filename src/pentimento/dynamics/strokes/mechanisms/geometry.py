"""Functions that mechanisms share: length, direction, speed and curvature of paths [B, S, N, 5], and softer edges."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from pentimento.dynamics.strokes.simulation import NotObservable, StrokeContext, View
from pentimento.dynamics.strokes.traj2stroke import Mark

SESSION = ("order", "tool_age_m", "t_before_s", "t_start_s", "t_after_s")
"""Columns that increase over a session."""
SHAPE = ("length_m", "press_m", "heading_cos", "heading_sin", "place_x_m", "place_y_m")
"""Covariates of a path's shape. For paths in their own frame, place and heading describe the bend."""
_MIN_LENGTH_M = 1e-9
_MIN_SPEED_M_S = 1e-4
_MAX_SHORTENING = 0.45  # of the stroke's length, at each end
_ONE_POINT_M = 1e-3
_ONE_PRESS_M = 1e-4
_ONE_DIRECTION = 1e-4  # 1 - the length of the mean direction


def steps_m(path: Tensor) -> Tensor:
    """Length of each segment, [B, S, N - 1]."""
    return path[..., 1:3].diff(dim=-2).norm(dim=-1)


def arc_m(path: Tensor) -> Tensor:
    """Length drawn from the stroke's start to each point, [B, S, N]."""
    along = steps_m(path).cumsum(-1)
    return torch.cat([torch.zeros_like(along[..., :1]), along], dim=-1)


def at_lengths(place_m: Tensor, arc: Tensor, field: Tensor) -> Tensor:
    """A field [B, S, N, D] at lengths along the path, [B, S, N]: straight between points."""
    after = (arc[..., None, :] < place_m[..., None]).sum(-1).clamp(1, arc.shape[-1] - 1)
    low, high = arc.gather(-1, after - 1), arc.gather(-1, after)
    share = ((place_m - low) / (high - low).clamp(min=1e-9))[..., None]
    after = after[..., None].expand(*after.shape, field.shape[-1])
    before, behind = field.gather(-2, after - 1), field.gather(-2, after)
    return before + share * (behind - before)  # the gradient of torch.lerp cannot be exported to ONNX


def moved_ends(
    points_m: Tensor, radius_m: Tensor, path: Tensor, start_m: float | Tensor, end_m: float | Tensor
) -> tuple[Tensor, Tensor]:
    """Points [B, S, N, 2] and radii [B, S, N] of a mark whose ends lie further out than its path's, by two lengths.

    All points move smoothly, so that a shortened stroke does not fold back on itself. The width at a place does not
    change. No end moves in beyond about the middle of the stroke.

    Args:
        path: [B, S, N, 5].
    """
    along, arc = tangent(path), arc_m(path)
    length = arc[..., -1:]
    share = arc / length.clamp(min=_MIN_LENGTH_M)
    start, end = (torch.maximum(torch.as_tensor(moved), -_MAX_SHORTENING * length) for moved in (start_m, end_m))
    forward = end * share**2 - start * (1 - share) ** 2
    place = (arc + forward).clamp(min=torch.zeros_like(length), max=length)
    return points_m + forward[..., None] * along, at_lengths(place, arc, radius_m[..., None])[..., 0]


def tangent(path: Tensor) -> Tensor:
    """Unit direction of motion at each point, [B, S, N, 2]; zero where the path does not move."""
    step = path[..., 1:3].diff(dim=-2)
    around = torch.cat([step[..., :1, :], step[..., 1:, :] + step[..., :-1, :], step[..., -1:, :]], dim=-2)
    return around / around.norm(dim=-1, keepdim=True).clamp(min=_MIN_LENGTH_M)


def speed_m_s(path: Tensor) -> Tensor:
    """Mean speed of each stroke, [B, S]; NaN where times are unknown or do not pass."""
    duration = path[..., -1, 0] - path[..., 0, 0]
    return torch.where(duration > 0, steps_m(path).sum(-1) / duration, torch.nan)


def bending_per_m(path: Tensor) -> Tensor:
    """Curvature at each point [1/m], positive where the path turns left (to +y from +x), [B, S, N]."""
    step = path[..., 1:3].diff(dim=-2)
    length = step.norm(dim=-1).clamp(min=_MIN_LENGTH_M)
    heading = step / length[..., None]
    cross = heading[..., :-1, 0] * heading[..., 1:, 1] - heading[..., :-1, 1] * heading[..., 1:, 0]
    inner = torch.asin(cross.clamp(-0.999, 0.999)) / ((length[..., 1:] + length[..., :-1]) / 2)
    return torch.cat([inner[..., :1], inner, inner[..., -1:]], dim=-1)


def trailing(points_m: Tensor, distance_m: Tensor) -> Tensor:
    """Points [B, S, N, 2] that follow ``points_m`` with a lag of ``distance_m`` [B, S, 1], cutting corners.

    The lag starts at 0 and, along a straight segment, relaxes exponentially to the distance; the solution is exact at
    the points. A negative distance gives the mirror image, so that an estimate may have either sign.
    """
    step = points_m.diff(dim=-2)
    length = step.norm(dim=-1, keepdim=True).clamp(min=_MIN_LENGTH_M)
    distance = distance_m.abs().clamp(min=_MIN_LENGTH_M)[..., None]
    behind = distance * step / length
    forgotten = torch.exp(-length / distance)
    trail = [points_m[..., 0, :]]
    for k in range(step.shape[-2]):
        rest = trail[-1] - points_m[..., k, :] + behind[..., k, :]
        trail.append(points_m[..., k + 1, :] - behind[..., k, :] + rest * forgotten[..., k, :])
    return points_m + torch.sign(distance_m)[..., None] * (torch.stack(trail, dim=-2) - points_m)


def delayed(points_m: Tensor, times_s: Tensor, late_s: Tensor) -> Tensor:
    """Points [B, S, N, 2] of a motion through ``points_m`` at ``times_s`` [B, S, N], delayed by ``late_s``.

    It waits at the first point; where the delay is negative, at the last.
    """
    then_s = torch.minimum(torch.maximum(times_s - late_s, times_s[..., :1]), times_s[..., -1:])
    return at_lengths(then_s, times_s, points_m)


def recorded(context: StrokeContext, *names: str) -> tuple[int, Tensor]:
    """The number of the first of these columns that is known for every stroke and varies, and the column, [B, S].

    Raises:
        NotObservable: none of them.
    """
    for number, name in enumerate(names):
        values = context.covariates.get(name)
        if values is not None and bool(torch.isfinite(values).all()) and varies(values):
            return number, values
    raise NotObservable(f"{' or '.join(names)} was not recorded for every stroke, or does not vary")


def column(context: StrokeContext, name: str) -> Tensor:
    """A column that an effect depends on, [B, S].

    Raises:
        NotObservable: it is not there.
    """
    if name not in context.covariates:
        raise NotObservable(f"{name} is not known of these strokes, and the mechanism depends on it")
    return context.covariates[name]


def varies(values: Tensor) -> bool:
    """Whether numbers differ by more than rounding."""
    return float(values.max() - values.min()) > 1e-3 * float(values.abs().max()) + 1e-12


def log_speed(context: StrokeContext, reference_m_s: float) -> Tensor:
    """log(speed / reference) of each stroke, [B, S, 1]; 0 where the speed is unknown."""
    logs = torch.log(speed_m_s(context.path).clamp(min=_MIN_SPEED_M_S) / reference_m_s)
    return torch.where(torch.isfinite(logs), logs, 0.0)[..., None]


def usual_speed(context: StrokeContext) -> dict[str, float]:
    """``speed_m_s``: the geometric mean over all strokes.

    Raises:
        NotObservable: times are unknown, or all strokes are equally fast.
    """
    logs = torch.log(speed_m_s(context.path).clamp(min=_MIN_SPEED_M_S))
    if not bool(torch.isfinite(logs).all()):
        raise NotObservable("the paths have no times, so that speeds are unknown")
    if float(logs.max() - logs.min()) < 0.05:
        raise NotObservable("all strokes are equally fast")
    return {"speed_m_s": float(logs.mean().exp())}


def place(context: StrokeContext) -> dict[str, float]:
    """``x_m``, ``y_m``: the middle of all strokes; ``half_m``: half the extent over which they lie.

    Raises:
        NotObservable: all strokes lie at one place, or their places are unknown.
    """
    xy = context.path[..., 1:3].mean(-2).flatten(0, -2)
    low, high = xy.amin(0), xy.amax(0)
    half = float((high - low).max()) / 2
    if in_own_frames(context):
        raise NotObservable("the strokes' places on the canvas are unknown")
    if half < _ONE_POINT_M:
        raise NotObservable("all strokes lie at one place")
    return {"x_m": float(low[0] + high[0]) / 2, "y_m": float(low[1] + high[1]) / 2, "half_m": half}


def in_own_frames(context: StrokeContext) -> bool:
    """Whether strokes are recorded in their own frames, all starting at one point, so that their places are unknown."""
    starts = context.path[..., 0, 1:3].flatten(0, -2)
    return len(starts) > 1 and float((starts.amax(0) - starts.amin(0)).max()) < _ONE_POINT_M


def headings_unknown(context: StrokeContext) -> bool:
    """Whether strokes are recorded in their own frames and along one direction, so that their headings are unknown."""
    chords = (context.path[..., -1, 1:3] - context.path[..., 0, 1:3]).flatten(0, -2)
    lengths = chords.norm(dim=-1)
    directions = chords[lengths > _ONE_POINT_M] / lengths[lengths > _ONE_POINT_M, None]
    spread = 1 - float(directions.mean(0).norm()) if len(directions) else 0.0
    return in_own_frames(context) and spread < _ONE_DIRECTION


def canvas_directions(context: StrokeContext) -> dict[str, float]:
    """No reference, for effects along the canvas's axes.

    Raises:
        NotObservable: the strokes' headings on the canvas are unknown.
    """
    if headings_unknown(context):
        raise NotObservable("it is unknown how the strokes are turned on the canvas")
    return {}


def press_varies(context: StrokeContext) -> bool:
    """Whether the press depth varies, so that its effect is identifiable."""
    return float(context.path[..., 3].max() - context.path[..., 3].min()) > _ONE_PRESS_M


def relative_place(xy_m: Tensor, reference: Mapping[str, float]) -> Tensor:
    """Canvas points [..., 2] about the reference's middle, in its half extents."""
    return (xy_m - torch.tensor([reference["x_m"], reference["y_m"]], dtype=xy_m.dtype)) / reference["half_m"]


def pixel_places(view: View, image: Tensor) -> Tensor:
    """Canvas coordinates of the pixel centres of images [B, H, W, C]: [B, H, W, 2]."""
    height, width = image.shape[1:3]
    k, x_min, y_max = view.pixels_per_m[:, None], view.top_left_m[:, :1], view.top_left_m[:, 1:]
    x = x_min + (torch.arange(width) + 0.5) / k
    y = y_max - (torch.arange(height) + 0.5) / k
    return torch.stack([x[:, None, :].expand(-1, height, -1), y[:, :, None].expand(-1, -1, width)], dim=-1)


_MIN_SOFTNESS = 0.05


def bleed(mark: Mark, softening: Tensor, spreading: Tensor) -> Mark:
    """The mark with ``exp(softening)`` times the softness and ``exp(spreading)`` times the width.

    Softening keeps the line of half darkness in place.
    """
    softer = mark.softness.clamp(min=_MIN_SOFTNESS) * torch.exp(softening)
    wider = mark.radius_m * _half_reach(mark.softness) / _half_reach(softer) * torch.exp(spreading)
    return mark._replace(radius_m=wider, softness=softer)


def _half_reach(softness: Tensor) -> Tensor:
    """Share of the radius at which a stroke is half as dark as on its path: (1 - D/R)^c = 1/2."""
    return 1 - torch.exp2(-1 / softness.clamp(min=_MIN_SOFTNESS))
