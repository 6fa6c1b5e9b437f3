"""The mark of a contact: discs, a swept box, or hairs, drawn by OpenCV at four times the photograph's resolution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from studies.another_simulator.arm import Command
from studies.another_simulator.world import Effects, ToolKind

Array = NDArray[Any]

_FINER, _SUBPIXEL = 4, 16
_HAIR_M, _HAIR_COVERS, _PAIRS = 0.0004, 0.75, 7
_USUAL_SPEED_M_S = 0.045


@dataclass(frozen=True)
class Tool:
    """A tool as it was drawn for a world."""

    kind: ToolKind
    narrow_m: float
    grows_m: float
    """Its width without press, and what full press adds: 1 - exp(-press / 1.5 mm) of it."""
    blur_m: float
    hairs: Array
    """[H, 3]: places in half-widths, and the press in metres from which a hair touches."""


def drawn_tool(rng: np.random.Generator, kind: ToolKind) -> Tool:
    """A tool; a tuft of hairs is isotropic."""
    radius, angle = np.sqrt(rng.random(_PAIRS)), rng.uniform(0, 2 * np.pi, _PAIRS)
    press_m = rng.uniform(0, 0.0005, _PAIRS)
    turned = [angle + k * np.pi / 2 for k in range(4)]
    hairs = np.concatenate([np.stack([radius * np.cos(a), radius * np.sin(a), press_m], axis=1) for a in turned])
    return Tool(kind, rng.uniform(0.0012, 0.002), rng.uniform(0.002, 0.004), rng.uniform(0.00025, 0.0005), hairs)


def widths_m(
    tool: Tool, effects: Effects, command: Command, *, xy_m: Array, press_m: Array, worn: float, damp: float
) -> Array:
    """Width of the contact at each point [M]; ``worn`` 0 to 1 over the session, ``damp`` about -1 to 1."""
    width = (tool.narrow_m + tool.grows_m * (1 - np.exp(-press_m / 0.0015))) * (press_m > 0)
    width = width * (command.speed_m_s / _USUAL_SPEED_M_S) ** -effects.speed_width
    width = width * (1 + effects.tool_wear * np.sqrt(worn)) * (1 + effects.paper_bleed * damp)
    if effects.curvature_width:
        step = np.gradient(xy_m, axis=0)
        turn = np.abs(np.gradient(np.unwrap(np.arctan2(step[:, 1], step[:, 0]))))
        bend_per_m = turn / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-7)
        bend = cv2.GaussianBlur(bend_per_m[None].astype(np.float32), (0, 0), 6)[0] * 0.01
        width = width * (1 + effects.curvature_width * np.minimum(bend, 1.5) ** 0.7)
    return np.asarray(width)


def mark(
    tool: Tool, xy_m: Array, press_m: Array, *, width_m: Array, yaw_rad: float, window_m: Array, pixels_per_m: float
) -> Array:
    """Coverage float32[H, W] in [0, 1] of a window (x_min, y_min, x_max, y_max)."""
    columns, rows = np.rint((window_m[2:] - window_m[:2]) * pixels_per_m).astype(int)
    k = pixels_per_m * _FINER
    fine = np.zeros((rows * _FINER, columns * _FINER), np.float32)
    at = np.stack([(xy_m[:, 0] - window_m[0]) * k, (window_m[3] - xy_m[:, 1]) * k], axis=1) - 0.5
    half_px = width_m * k / 2
    match tool.kind:
        case "nib":
            for point, half in zip(at, half_px, strict=True):
                if half > 0:
                    cv2.circle(fine, _fixed(point).tolist(), round(half * _SUBPIXEL), 1.0, -1, cv2.LINE_AA, 4)
        case "chisel":
            _sweep(fine, at, half_px, yaw_rad)
        case "hairs":
            for x, y, touches_m in tool.hairs:
                touching = (press_m > touches_m) & (half_px > 0)
                hair = (at + half_px[:, None] * np.array([x, y]))[touching]
                one = np.zeros_like(fine)
                cv2.polylines(one, [_fixed(hair)], False, 1.0, max(int(_HAIR_M * k), 1), cv2.LINE_AA, 4)
                fine = 1 - (1 - fine) * (1 - _HAIR_COVERS * one)
    fine = cv2.GaussianBlur(fine, (0, 0), tool.blur_m * k)
    return np.asarray(cv2.resize(fine, (int(columns), int(rows)), interpolation=cv2.INTER_AREA))


def _sweep(fine: Array, at: Array, half_px: Array, yaw_rad: float) -> None:
    """A box three times as broad as deep, from point to point."""
    broad = np.array([np.cos(yaw_rad), -np.sin(yaw_rad)])
    deep = np.array([np.sin(yaw_rad), np.cos(yaw_rad)]) / 3
    corners = np.array([i * broad + j * deep for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    boxes = at[:, None] + half_px[:, None, None] * corners
    for k in range(len(at) - 1):
        if half_px[k] > 0 and half_px[k + 1] > 0:
            hull = cv2.convexHull(np.concatenate([boxes[k], boxes[k + 1]]).astype(np.float32))
            cv2.fillConvexPoly(fine, _fixed(hull), 1.0, cv2.LINE_AA, 4)


def _fixed(points: Array) -> Array:
    """Pixels in OpenCV's fixed point."""
    return np.rint(points * _SUBPIXEL).astype(np.int32)
