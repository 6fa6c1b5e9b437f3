"""The true motion of the tool's tip for a commanded path.

Errors are applied in the order of the machine. The servo follows its command late (`latency`). The gears have play
(`backlash`). The arm's frame is scaled and shifted against the sheet (`path_scale`, `path_offset`). Encoders sit on the
motors, so that they measure the latency only.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.studio.shared import Gears
from pentimento.studio.strokes.world import Effects, Robot

STEP_M = 0.00032  # between samples of the motion; a bristle's diameter is about two of them
MAX_STEPS = 6000
DEAD_TIME_SHARE = 0.4  # of the latency; the rest is the servo's own

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tip:
    """The tip's true motion in the canvas frame, at uniform time steps.

    pose: float64[M,4] x_m, y_m, z_m, yaw_rad; speed_m_s: float64[M]; encoders: float64[N,5] as the command;
    gears: after the motion.
    """

    pose: Array
    speed_m_s: Array
    encoders: Array
    gears: Gears


def execute(
    path: Array,
    robot: Robot,
    effects: Effects,
    *,
    canvas_size_m: tuple[float, float],
    gears: Gears,
    rng: np.random.Generator,
) -> Tip:
    """The tip's motion for a command `path` (float64[N,5] t_s, x_m, y_m, z_m, yaw_rad; t increasing, all finite)."""
    encoder_noise = rng.standard_normal((len(path), 3)) * robot.encoder_noise_m
    seat_m = rng.standard_normal(2) * robot.repeatability_m
    command, step_s = _resample(path)
    followed = command.copy()
    lag_s = effects.latency * robot.latency_s
    if lag_s > 0:
        for axis in (0, 1, 3):  # the lift is a short, stiff axis with its own fast servo
            _follow(
                command[:, axis],
                step_s,
                lag_s * DEAD_TIME_SHARE,
                lag_s * (1 - DEAD_TIME_SHARE),
                followed[:, axis],
            )
    encoders = _read_encoders(path, followed, step_s, encoder_noise)
    # The motion to the stroke's start counts: it decides on which side of their play the gears rest.
    xy, play_m = np.vstack([gears.rest_m, followed[:, :2]]), [0.0, 0.0]
    for axis in (0, 1):
        half_play_m = 0.5 * effects.backlash * robot.backlash_m[axis]
        play_m[axis] = _play(xy[:, axis], half_play_m, gears.play_m[axis])
    xy = xy[1:]
    xy = _misplace(xy, path[0, 1:3], robot, effects, canvas_size_m) + seat_m
    speed = np.hypot(*np.gradient(xy, axis=0).T) / step_s
    pose = np.column_stack([xy, followed[:, 2:]])
    rest = Gears((float(followed[-1, 0]), float(followed[-1, 1])), (play_m[0], play_m[1]))
    return Tip(pose, speed, encoders, rest)


def _resample(path: Array) -> tuple[Array, float]:
    """Path at uniform time steps: float64[M,4] x, y, z, yaw, and the step."""
    length_m = float(np.linalg.norm(np.diff(path[:, 1:4], axis=0), axis=1).sum())
    count = int(np.clip(np.ceil(length_m / STEP_M), 8, MAX_STEPS)) + 1
    times = np.linspace(path[0, 0], path[-1, 0], count)
    columns = [np.interp(times, path[:, 0], path[:, i]) for i in (1, 2, 3)]
    columns.append(np.interp(times, path[:, 0], np.unwrap(path[:, 4])))
    return np.column_stack(columns), float(times[1] - times[0])


@njit(cache=True)
def _follow(command: Array, step_s: float, dead_s: float, servo_s: float, out: Array) -> None:
    """Dead time, then a critically damped servo with the ramp lag `servo_s` = 2/omega, integrated in substeps."""
    omega = 2.0 / servo_s
    substeps = int(np.ceil(step_s * omega / 0.04))
    h = step_s / substeps
    position, velocity = command[0], 0.0
    for k in range(command.size):
        out[k] = position
        delayed = k + 0.5 - dead_s / step_s  # the command in the middle of the coming step
        below = int(np.floor(delayed))
        if below < 0:
            target = command[0]
        else:
            share = delayed - below
            after = min(below + 1, command.size - 1)
            target = command[min(below, after)] * (1 - share) + command[after] * share
        for _ in range(substeps):
            velocity += h * (omega * omega * (target - position) - 2 * omega * velocity)
            position += h * velocity


@njit(cache=True)
def _play(position: Array, half_play_m: float, offset_m: float) -> float:
    """Play operator, in place: the driven side moves only when the motor has crossed the gap.

    Returns the last offset of the driven side.
    """
    offset = min(max(offset_m, -half_play_m), half_play_m)
    last = position[0]
    for k in range(position.size):
        offset = min(max(offset + last - position[k], -half_play_m), half_play_m)
        last = position[k]
        position[k] = last + offset
    return offset


def _misplace(xy: Array, start: Array, robot: Robot, effects: Effects, canvas_size_m: tuple[float, float]) -> Array:
    """Scale about the stroke's start, then shift; the shift rotates over the sheet as a registration error does."""
    scale = 1 + effects.path_scale * (np.asarray(robot.scale) - 1)
    centre = 0.5 * np.asarray(canvas_size_m)
    relative = (xy - centre) / centre[0]
    offset = np.asarray(robot.offset_m)
    turn = 0.15 * float(np.hypot(*offset)) * np.column_stack([-relative[:, 1], relative[:, 0]])
    return np.asarray(start + (xy - start) * scale + effects.path_offset * (offset + turn))


def _read_encoders(path: Array, followed: Array, step_s: float, noise: Array) -> Array:
    times = path[0, 0] + step_s * np.arange(len(followed))
    encoders = path.copy()
    for column in (1, 2, 3, 4):
        encoders[:, column] = np.interp(path[:, 0], times, followed[:, column - 1])
    encoders[:, 1:4] += noise
    return encoders
