"""The true motion of the tool's tip for a commanded push.

The commanded tip starts at the surface and sinks linearly while it travels (thesis 7.3.2). Errors: play of the gears
(`tool_backlash`), an offset of the arm's zero height (`height_offset`), and the error of the measured surface height.
"""

import math

import numpy as np
from numpy.typing import NDArray

from pentimento.studio.clay.world import Arm, ClayEffects, ToolShape
from pentimento.studio.shared import Gears

Array = NDArray[np.float64]

STEP_M = 0.0004
SINK_STEP_M = 0.00025
MIN_STEPS = 12
RESTING_STEPS = 8  # at the end of travel, in which the tool settles into the displaced material


def commanded_line(action: Array, surface_m: float) -> Array:
    """Tip float64[M,3] x_m, y_m, z_m (above the table) of a push, `RESTING_STEPS` at its end included."""
    x_m, y_m, theta, length_m, depth_m = (float(v) for v in action)
    steps = max(MIN_STEPS, math.ceil(length_m / STEP_M), math.ceil(depth_m / SINK_STEP_M))
    s = np.concatenate([np.linspace(0.0, 1.0, steps + 1), np.ones(RESTING_STEPS)])
    return np.column_stack(
        [x_m + s * length_m * math.cos(theta), y_m + s * length_m * math.sin(theta), surface_m - s * depth_m]
    )


def executed_line(
    command: Array,
    arm: Arm,
    effects: ClayEffects,
    *,
    size_m: tuple[float, float],
    gears: Gears,
    rng: np.random.Generator,
) -> tuple[Array, Gears]:
    """The tip's line for a command float64[M,3], and the gears after it."""
    seat_m, contact_m = arm.repeatability_m * rng.standard_normal(2), arm.contact_error_m * rng.standard_normal()
    line = command.copy()
    play_m = [0.0, 0.0]
    for axis in (0, 1):
        half_m = 0.5 * effects.tool_backlash * arm.backlash_m[axis]
        moved = np.diff(command[:, axis], prepend=gears.rest_m[axis])  # the motion to the start counts
        offset = gears.play_m[axis]
        for k, step_m in enumerate(moved):
            offset = min(max(offset + step_m, -half_m), half_m)
            line[k, axis] -= offset
        play_m[axis] = offset
    from_centre = 2 * line[:, :2] / np.asarray(size_m) - 1  # -1..1
    sag = from_centre @ np.asarray(arm.offset_tilt_m) + 0.3 * arm.offset_m * (from_centre**2).sum(axis=1)
    line[:, 2] -= effects.height_offset * (arm.offset_m + sag) + contact_m
    line[:, :2] += seat_m
    rest = Gears((float(command[-1, 0]), float(command[-1, 1])), (play_m[0], play_m[1]))
    return line, rest


def finger_lines(tool: ToolShape, line: Array, action: Array) -> list[tuple[Array, Array]]:
    """Line float64[M,3] (x_m, y_m, z_m) and heading float64[2] of the one tool, or of each finger of a gripper.

    The fingers stand on both sides of the line's start and close by as much as a single tool would travel.
    """
    along = np.array([math.cos(action[2]), math.sin(action[2])])
    if tool.spread_m == 0.0:
        return [(line, along)]
    closed_m = np.hypot(*(line[:, :2] - line[0, :2]).T)
    beside_m = 0.5 * (tool.spread_m - closed_m) + tool.half_length_m
    fingers = []
    for side in (1.0, -1.0):
        finger = line.copy()
        finger[:, :2] = line[0, :2] + side * beside_m[:, None] * along
        fingers.append((finger, -side * along))
    return fingers


def encoder_path(command: Array, action: Array, speed_m_s: float, arm: Arm, rng: np.random.Generator) -> Array:
    """Encoder readings, float64[M,5] t_s, x_m, y_m, z_m, yaw_rad; they include neither play nor compliance."""
    step_m = np.hypot(*np.diff(command[:, :2], axis=0, prepend=command[:1, :2]).T)
    times = np.cumsum(np.maximum(step_m / speed_m_s, 0.004))
    noise = arm.encoder_noise_m * rng.standard_normal(command.shape)
    return np.column_stack([times - times[0], command + noise, np.full(len(command), action[2])])
