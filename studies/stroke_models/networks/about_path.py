"""Features of pixels relative to strokes: to the predicted mark, to the command, in the stroke's own frame.

Lengths are metres; left of the direction of motion is positive.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from pentimento.dynamics.strokes.mechanisms.geometry import arc_m, at_lengths, bending_per_m
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.traj2stroke import Mark
from studies.stroke_models.networks.coverage import drawn
from studies.stroke_models.networks.frame import frames_of, local_paths, places_of

_SHORTEST_M = 1e-9
_GENTLE_PER_M = 30.0
"""Bends of a radius above some 30 mm count in proportion, sharper ones by their logarithm."""

_AWAY_MM = (-30, -20, -10, -5, 5, 10, 20)
"""Lengths along the command, from the nearest place, at which the tip was or will be: a brush remembers its way."""

_ABOUT_LINE = ("left", "ahead", "from start", "to end", "press", "bend")
_LOCAL = (
    *(f"{name}, mark" for name in _ABOUT_LINE), "distance", "half-width", "left in half-widths",
    "ahead in half-widths", "coverage", *(f"{name}, command" for name in _ABOUT_LINE), "x", "y", "x from end",
    *(f"tip at {away} mm, {side}" for away in _AWAY_MM for side in ("ahead", "left")),
)  # fmt: skip
_QUARTERS = ("y at 1/4", "y at 1/2", "y at 3/4")
_OF_STROKE = ("length", "chord", *_QUARTERS, "heading at start", "heading at end", "deepest press")
NAMES = (*_LOCAL, *_OF_STROKE)
"""Names of the features."""
_ODD = {
    "left, mark", "bend, mark", "left in half-widths", "left, command", "bend, command", "y", *_QUARTERS,
    "heading at start", "heading at end", *(f"tip at {away} mm, left" for away in _AWAY_MM),
}  # fmt: skip


def odd() -> Tensor:
    """[F] -1 for features that change sign in a mirror about the stroke's x axis, 1 for the others."""
    return torch.tensor([-1.0 if name in _ODD else 1.0 for name in NAMES])


class Nearest(NamedTuple):
    """The nearest places of a polyline to P points."""

    segment: Tensor  # [P] int64
    along: Tensor  # [P] where on it, 0 to 1
    left_m: Tensor  # [P] how far left of it a point lies
    ahead_m: Tensor  # [P] how far ahead of it: 0 but at ends and corners
    heading: Tensor  # [P, 2] of the segment, a unit vector; 0 where it has no length

    def there(self, values: Tensor) -> Tensor:
        """Values [N] of the polyline's points at the nearest places, [P]."""
        return values[self.segment] + self.along * (values[self.segment + 1] - values[self.segment])


def nearest(line_m: Tensor, points_m: Tensor) -> Nearest:
    """Of a polyline [N, 2] to points [P, 2]."""
    start, step = line_m[:-1], line_m.diff(dim=0)
    away = points_m[:, None] - start
    along = ((away * step).sum(-1) / step.square().sum(-1).clamp(min=_SHORTEST_M**2)).clamp(0.0, 1.0)
    rest = away - along[..., None] * step  # [P, N - 1, 2]
    segment = rest.square().sum(-1).argmin(1)
    here = torch.arange(len(points_m))
    rest, heading = rest[here, segment], (step / step.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST_M))[segment]
    left = heading[:, 0] * rest[:, 1] - heading[:, 1] * rest[:, 0]
    return Nearest(segment, along[here, segment], left, (heading * rest).sum(-1), heading)


def about_path(mark: Mark, samples: StrokeSamples) -> Tensor:
    """Features of each pixel, [B, H, W, F], in the order of ``NAMES``.

    Args:
        mark: predicted for each stroke, [B, N, ...].
    """
    height, width = samples.valid.shape[1:]
    frames, command = frames_of(samples.path), local_paths(samples.path)
    moved, places = frames.to_stroke(mark.points_m), places_of(samples)
    radius = mark.radius_m * samples.pixels_per_m[:, None]
    covered = drawn(samples.view.to_pixels(mark.points_m), radius, mark.density, mark.softness, (height, width))
    arc, bend = arc_m(samples.path), torch.asinh(bending_per_m(samples.path) / _GENTLE_PER_M)
    press, whole = (-samples.path[..., 3]).clamp(min=0.0), _of_strokes(samples.path)
    features = [
        torch.cat(
            [
                _of_pixels(
                    moved[b], command[b], mark.radius_m[b],
                    covered=covered[b].flatten(), places=places[b].reshape(-1, 2),
                    along=torch.stack([arc[b], press[b], bend[b]]),
                ),
                whole[b].expand(height * width, -1),
            ],
            dim=1,
        ).view(height, width, -1)
        for b in range(len(command))
    ]  # fmt: skip
    return torch.stack(features)


def _of_pixels(
    mark: Tensor, command: Tensor, half_width: Tensor, *, covered: Tensor, places: Tensor, along: Tensor
) -> Tensor:
    """[P, ``_LOCAL``] of one stroke; ``along`` [3, N]: arc, press and bend of its points."""
    by_mark, by_command = nearest(mark, places), nearest(command, places)
    half = by_mark.there(half_width)
    distance = torch.hypot(by_mark.left_m, by_mark.ahead_m)
    columns = [
        *_about_line(by_mark, along), distance, half, by_mark.left_m / half, by_mark.ahead_m / half, covered,
        *_about_line(by_command, along), places[:, 0], places[:, 1], places[:, 0] - command[-1, 0],
        *_of_the_way(by_command, command, along[0], places),
    ]  # fmt: skip
    return torch.stack(columns, dim=1)


def _of_the_way(by: Nearest, command: Tensor, arc: Tensor, places: Tensor) -> list[Tensor]:
    """Where the tip was and will be, seen from each pixel: ahead and left of the heading at its nearest place."""
    there = (by.there(arc) + 1e-3 * torch.tensor(_AWAY_MM)[:, None]).clamp(min=0.0, max=float(arc[-1]))  # [A, P]
    tip = at_lengths(there[None], arc.expand(1, len(_AWAY_MM), -1), command.expand(1, len(_AWAY_MM), -1, -1))[0]
    away, heading = tip - places, by.heading
    ahead, left = (away * heading).sum(-1), heading[:, 0] * away[..., 1] - heading[:, 1] * away[..., 0]
    return [side for both in zip(ahead, left, strict=True) for side in both]


def _about_line(by: Nearest, along: Tensor) -> list[Tensor]:
    arc, press, bend = along
    come = by.there(arc)
    return [by.left_m, by.ahead_m, come, arc[-1] - come, by.there(press), by.there(bend)]


def _of_strokes(path: Tensor) -> Tensor:
    """[B, ``_OF_STROKE``] of commanded paths [B, N, 5]."""
    local, points = local_paths(path), path.shape[1]
    reach = max(points // 10, 1)
    start, end = local[:, reach] - local[:, 0], local[:, -1] - local[:, -1 - reach]
    quarters = [local[:, points * quarter // 4, 1] for quarter in (1, 2, 3)]
    headings = [torch.atan2(step[:, 1], step[:, 0]) for step in (start, end)]
    deepest = (-path[..., 3]).clamp(min=0.0).amax(1)
    return torch.stack([arc_m(path)[:, -1], local[:, -1, 0], *quarters, *headings, deepest], dim=1)
