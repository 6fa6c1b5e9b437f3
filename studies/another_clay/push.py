"""One push into the second clay, faults included. Millimetres, seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from studies.another_clay.ploughing import PIXEL_MM, PIXELS, SIZE_MM, plough, slide
from studies.another_clay.world import Clay, Effects

Array = NDArray[Any]

_PLACES = (np.arange(PIXELS) + 0.5) * PIXEL_MM
X_MM, Y_MM = np.meshgrid(_PLACES, SIZE_MM - _PLACES)
_STATION_MM, _DEEPER_MM, _FEWEST = 0.6, 0.35, 4
_AT_REST = 6
"""Stations at the end of the way."""
_FELT_MM = 3.0
"""Radius about the start in which the surface is felt."""
_NEAR_MM = 8
_CREEP_S = 2.5
_FAR_MM = 35.0


@dataclass(frozen=True)
class Command:
    """The commanded push, relative to the surface at its start."""

    x_mm: float
    y_mm: float
    theta_rad: float
    length_mm: float
    depth_mm: float
    dwell_s: float
    speed_m_s: float
    retract_speed_m_s: float


@dataclass(frozen=True)
class Conditions:
    """What a push finds: what was measured of it, and how much of the session's stiffening has come, 0 on average."""

    temperature_c: float
    humidity_pct: float
    supply_v: float
    stiffened: float


def pushed(
    before: Array,
    worked: Array,
    command: Command,
    *,
    conditions: Conditions,
    clay: Clay,
    effects: Effects,
    rough: Array,
) -> Array:
    """Heights [N, N] after a push.

    Args:
        worked: how much each place was pressed since the clay was smoothed.
        rough: what a push may leave of roughness, of unit size.
    """
    height = before.copy()
    gain = 1.0 + effects.stiff_when_cold * math.tanh((conditions.temperature_c - 22.0) / 2.5)
    gain *= 1.0 - effects.stiffens * conditions.stiffened
    gain *= 1.0 + effects.deep_by_volts * (conditions.supply_v - 24.0) / 0.6
    wider = 1.0 + effects.wide_when_damp * (conditions.humidity_pct - 45.0) / 12.0
    depth_mm = command.depth_mm * gain
    way = _way(before, command, depth_mm, effects)
    end_x, end_y = way[-1, :2]
    flank = math.tan(math.radians(clay.flank_deg))
    heading = math.cos(command.theta_rad), math.sin(command.theta_rad)
    forward = clay.forward if command.length_mm > 1.0 else 0.0
    sent_far = plough(
        height, worked, way, (clay.ball_mm, flank, wider), (clay.spread_mm, forward, clay.aside), heading,
        effects.work_hardening, effects.volume_loss, effects.far_field,
    )  # fmt: skip
    touched = np.clip(1.5 * gaussian_filter((np.abs(height - before) > 0.03).astype(float), 2.0), 0, 1)
    height += touched * (gaussian_filter(height, clay.smooth_mm / PIXEL_MM) - height)
    if sent_far > 0:
        around = (1.0 + np.square(_away(way[:, 0].mean(), way[:, 1].mean()) / _FAR_MM)) ** -1.5
        height += sent_far * around / around.sum()
    if effects.slope_slide > 0:
        rows, columns = np.nonzero(touched > 0.05)
        box = (
            max(rows.min() - _NEAR_MM, 0), min(rows.max() + _NEAR_MM, PIXELS),
            max(columns.min() - _NEAR_MM, 0), min(columns.max() + _NEAR_MM, PIXELS),
        )  # fmt: skip
        slide(height, math.tan(math.radians(clay.flank_deg - effects.slope_slide)), box, 60)
    if effects.springback > 0:
        kept_in = effects.springback * math.exp(-command.dwell_s / _CREEP_S)
        height += kept_in * gaussian_filter(np.clip(before - height, 0, None), 1.0 / PIXEL_MM)
    if effects.adhesion_lift > 0:
        height += _drawn_up(_away(end_x, end_y), max(depth_mm, 0.5), command, clay, effects)
    return np.asarray(height + clay.tear_mm * rough * touched)


def _way(before: Array, command: Command, depth_mm: float, effects: Effects) -> Array:
    """Stations [n, 4] as of ``plough``: the tool goes down as it travels, and rests at the end."""
    surface = float(np.median(before[_away(command.x_mm, command.y_mm) <= _FELT_MM]))
    ahead, left = math.cos(command.theta_rad), math.sin(command.theta_rad)
    count = max(math.ceil(command.length_mm / _STATION_MM), math.ceil(command.depth_mm / _DEEPER_MM), _FEWEST)
    part = np.linspace(0.0, 1.0, count + 1)
    part = np.append(part, np.ones(_AT_REST))
    x = command.x_mm - effects.tool_backlash * math.tanh(3 * ahead) + ahead * command.length_mm * part
    y = command.y_mm - 0.6 * effects.tool_backlash * math.tanh(3 * left) + left * command.length_mm * part
    # A long rest lets the tool sink beyond its depth; after a short one it is short of that.
    sinks = effects.sinks_at_rest * (math.log1p(command.dwell_s / 0.6) - 1.25)
    rested = np.clip((np.arange(len(part)) - count) / 3, 0, 1) if sinks > 0 else part**2
    tip = surface - depth_mm * part - effects.height_offset - sinks * rested
    return np.stack([x, y, tip, depth_mm * part], axis=1)


def _drawn_up(away_mm: Array, depth_mm: float, command: Command, clay: Clay, effects: Effects) -> Array:
    """Clay that sticks to a ball as it leaves, out of a ring around it; no volume comes or goes."""
    deep = min(depth_mm, clay.ball_mm)
    contact_mm = math.sqrt(max(2 * clay.ball_mm * deep - deep * deep, 1.0))
    lift = effects.adhesion_lift * math.log1p(command.retract_speed_m_s / 0.02) * contact_mm / 8.0
    cap = np.clip(1 - np.square(away_mm / contact_mm), 0, None) ** 0.7
    ring = np.exp(-np.square((away_mm - contact_mm - 1.5) / 2.0))
    return np.asarray(lift * (cap - ring * cap.sum() / ring.sum()))


def _away(x_mm: float, y_mm: float) -> Array:
    return np.hypot(X_MM - x_mm, Y_MM - y_mm)
