"""What the robot executed, by its own sensors: measured paths in place of commands, and press from force.

A measured path holds the robot's following error. Along it, only the tool's own deviation is left to explain. The delay
of the robot is estimated from command and measured path alone, without photographs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.polynomial.legendre import Legendre
from numpy.typing import NDArray

from pentimento.contracts.schema import PATH

Array = NDArray[Any]

_DEGREE = 6
"""Of the polynomial in time by which a stroke's deviation from its delayed command is smoothed, in each axis."""
_POINTS_PER_COEFFICIENT = 4
_HALF_STEP_S = 0.004
"""Of the finite difference that gives the commanded velocity."""
_ITERATIONS = 30
_CONVERGED_S = 1e-7
_USUAL_SCALE = 0.1
_USUAL_OFFSET_M = 0.005
"""Prior scales of the measured path's scale and offset, for strokes of one heading, which leave some of them open."""
_SURE_Z = 3.0
_SHORTEST_S = 5e-4
"""Delay below which a robot counts as prompt."""
_CONSTANT_Z_M = 1e-4
_USUAL_PRESS_M = 1e-3
"""Nominal press at the median force; the base's half-width curve is free, so that its unit does not matter."""


class Following(NamedTuple):
    """How late the robot's measured path is behind its command."""

    delay_s: float
    se_s: float
    """Standard error, clustered by action."""

    @property
    def late(self) -> bool:
        """Whether there is a delay."""
        return self.delay_s > max(_SURE_Z * self.se_s, _SHORTEST_S)

    def sentence(self) -> str:
        """For the verdict."""
        size = f"{1e3 * self.delay_s:.3g} ± {1e3 * self.se_s:.1g} ms".replace("-", "−")
        if self.late:
            return f"The robot follows its command {size} late (measured); the rest is the tool's."
        return f"The robot follows its command without a delay ({size}, measured); the rest is the tool's."


class Executed(NamedTuple):
    """Strokes as the robot measured them."""

    table: pa.Table
    """``path`` is the measured one, its press from force where that is said; otherwise as commanded."""
    following: Following | None
    """None where paths are as commanded, because some were not measured with their times."""
    press_from_force: bool


def executed(table: pa.Table) -> Executed:
    """The strokes of a table by what the robot measured.

    A measured path is used where every row has one, and all its times and those of its command are known. Force is used
    as press where every row has it, it varies, and z does not.
    """
    paths = [np.asarray(path, dtype=np.float64) for path in table["path"].to_pylist()]
    measured = _timed_paths(table)
    following = None
    if measured is not None and all(np.isfinite(path[:, 0]).all() for path in paths):
        following = following_of(paths, measured, np.asarray(table["action_id"].to_pylist()))
        paths = [followed(*pair, following.delay_s) for pair in zip(paths, measured, strict=True)]
    press = _press_by_force(table, paths)
    if press is not None:
        for path, press_m in zip(paths, press, strict=True):
            path[:, 3] = -press_m
    if following is not None or press is not None:
        column = pa.array([path.tolist() for path in paths], PATH)
        table = table.set_column(table.schema.get_field_index("path"), "path", column)
    return Executed(table, following, press is not None)


def measures_paths(table: pa.Table) -> bool:
    """Whether every row has a measured path with its times."""
    return _timed_paths(table) is not None


def followed(command: Array, measured: Array, delay_s: float) -> Array:
    """A measured path without its noise, float64[M, 5] at the measured times, with the command's yaw.

    Only the deviation from the delayed command is smoothed, so that the path keeps the command's bends.
    """
    t_s, then_s = measured[:, 0], measured[:, 0] - delay_s
    wanted = np.column_stack([command[:, 1:4], np.unwrap(command[:, 4])])
    path = np.column_stack([t_s, *(np.interp(then_s, command[:, 0], column) for column in wanted.T)])
    degree = min(_DEGREE, len(t_s) // _POINTS_PER_COEFFICIENT)
    for axis in (1, 2, 3):
        path[:, axis] += Legendre.fit(t_s, measured[:, axis] - path[:, axis], degree)(t_s)
    return path


def following_of(commands: Sequence[Array], measured: Sequence[Array], action: Array) -> Following:
    """Delay of measured paths [M, 5] behind their commands [N, 5], by least squares over x and y.

    measured(t) = start + scale · (command(t − delay) − start) + offset, with one delay, scale and offset [2] for all
    strokes: a scaled or shifted frame is no delay.

    Args:
        action: [B] of each stroke; strokes of one value share their errors.
    """
    numbers = np.zeros(5)
    prior = np.array([np.inf, _USUAL_SCALE, _USUAL_SCALE, _USUAL_OFFSET_M, _USUAL_OFFSET_M])
    pairs = list(zip(commands, measured, strict=True))
    for _ in range(_ITERATIONS):
        parts = [_linearised(*pair, numbers) for pair in pairs]
        variance = np.mean(np.concatenate([residual for residual, _ in parts]) ** 2)
        curvature = sum(jacobian.T @ jacobian for _, jacobian in parts) + np.diag(variance / prior**2)
        slopes = np.array([jacobian.T @ residual for residual, jacobian in parts])
        step = np.linalg.solve(curvature, slopes.sum(0) - variance * numbers / prior**2)
        numbers = numbers + step
        if abs(step[0]) < _CONVERGED_S:
            break
    inverse = np.linalg.inv(curvature)
    _, group = np.unique(action, return_inverse=True)
    by_action = np.zeros((group.max() + 1, 5))
    np.add.at(by_action, group, slopes)
    clustered = inverse @ (by_action.T @ by_action) @ inverse
    # Few actions make the clustered error too small.
    return Following(float(numbers[0]), float(np.sqrt(max(clustered[0, 0], variance * inverse[0, 0]))))


def _linearised(command: Array, measured: Array, numbers: Array) -> tuple[Array, Array]:
    """Residual [2 M] of a measured path and its derivatives [2 M, 5] by delay, scale (x, y) and offset (x, y)."""
    delay_s, scale, offset_m = numbers[0], 1 + numbers[1:3], numbers[3:]
    then_s = measured[:, 0] - delay_s

    def at(seconds: Array) -> Array:
        return np.stack([np.interp(seconds, command[:, 0], command[:, axis]) for axis in (1, 2)], axis=1)

    away = at(then_s) - command[0, 1:3]
    velocity = (at(then_s + _HALF_STEP_S) - at(then_s - _HALF_STEP_S)) / (2 * _HALF_STEP_S)
    residual = measured[:, 1:3] - command[0, 1:3] - scale * away - offset_m
    jacobian = np.zeros((*residual.shape, 5))
    jacobian[..., 0] = -scale * velocity
    for axis in (0, 1):
        jacobian[:, axis, 1 + axis], jacobian[:, axis, 3 + axis] = away[:, axis], 1.0
    return residual.ravel(), jacobian.reshape(-1, 5)


def _complete(table: pa.Table, name: str) -> bool:
    return table.num_rows > 0 and name in table.schema.names and table[name].null_count == 0


def _timed_paths(table: pa.Table) -> list[Array] | None:
    """Measured path of each row with increasing times; None where a row has none."""
    if not _complete(table, "measured_path"):
        return None
    paths = [np.asarray(path, dtype=np.float64) for path in table["measured_path"].to_pylist()]
    enough = all(len(path) > _POINTS_PER_COEFFICIENT and np.isfinite(path).all() for path in paths)
    return paths if enough and all((np.diff(path[:, 0]) > 0).all() for path in paths) else None


def _press_by_force(table: pa.Table, paths: Sequence[Array]) -> list[Array] | None:
    """Press [m] at the points of each path in proportion to the force; None where z tells it, or force does not."""
    if not _complete(table, "force_n"):
        return None
    forces = [np.asarray(force, dtype=np.float64) for force in table["force_n"].to_pylist()]
    z_m, force_n = np.concatenate([path[:, 3] for path in paths]), np.concatenate(forces)
    if not all(len(force) for force in forces) or not np.isfinite(force_n).all():
        return None
    usual_n = float(np.median(force_n))
    if np.ptp(z_m) > _CONSTANT_Z_M or usual_n <= 0 or np.ptp(force_n) < 0.1 * usual_n:
        return None
    return [
        np.interp(np.linspace(0, 1, len(path)), np.linspace(0, 1, len(force)), force) * _USUAL_PRESS_M / usual_n
        for path, force in zip(paths, forces, strict=True)
    ]
