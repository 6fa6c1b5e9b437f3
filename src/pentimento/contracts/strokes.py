"""The `strokes` table: one row for each executed stroke, measured or simulated."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pentimento.contracts.colour import linear_to_srgb, srgb_to_linear, to_uint8
from pentimento.contracts.frames import image_shape, pixel_to_canvas
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import IMAGE, PATH, TableContract, arrow_schema, known, needed, vector

FRAMES: Final = ("canvas", "stroke")
ENCODINGS: Final = ("srgb", "ink")


_TIP = "tip: t from the stroke's start, x, y, z, yaw (0 = a flat tool's broad edge along +x)"

CONTRACT: Final = TableContract(
    name="strokes",
    description="One row for each executed stroke, measured or simulated.",
    columns=(
        needed("session", pa.string(), "one uninterrupted recording: same tool, paint, camera pose"),
        needed("order", pa.int32(), "execution order in the session"),
        needed("action_id", pa.int32(), "rows of one value repeat the same commanded action"),
        needed("tool", pa.string(), "name of the tool, e.g. round_brush"),
        needed("path", PATH, f"commanded {_TIP}", "s, m, m, m, rad", "see `frame`", may_be_nan=(0,)),
        needed("window_m", vector(4), "x_min, y_min, x_max, y_max of both images", "m", "see `frame`"),
        needed("before", IMAGE, "PNG of the canvas in that window before the stroke", "", "image"),
        needed("after", IMAGE, "PNG of the canvas in that window after the stroke", "", "image"),
        known("frame", pa.string(), "canvas (default), or stroke: origin at its start", choices=FRAMES),
        known("encoding", pa.string(), "srgb (default), or ink: grey = 255 - ink mask", choices=ENCODINGS),
        known("medium", pa.string(), "kind of paint or ink"),
        known("surface", pa.string(), "kind of paper or canvas"),
        known("surface_id", pa.string(), "which sheet"),
        known("tool_id", pa.string(), "which specimen of the tool"),
        known("camera_id", pa.string(), "which camera"),
        known("color_srgb", vector(3), "colour of the paint, in [0, 1]"),
        known("previous_color_srgb", vector(3), "colour of the paint before, in [0, 1]"),
        known("t_start_s", pa.float64(), "start of the stroke since the session's start", "s"),
        known("t_before_s", pa.float64(), "time of the photo before, since the session's start", "s"),
        known("t_after_s", pa.float64(), "time of the photo after, since the session's start", "s"),
        known("session_start_unix_s", pa.float64(), "start of the session, Unix time", "s"),
        known("since_reload", pa.int32(), "strokes since the last dip; 0 = first"),
        known("reload_id", pa.int32(), "which dip"),
        known("ink_since_reload_m", pa.float32(), "length drawn since the dip, before this stroke", "m"),
        known("tool_age_m", pa.float32(), "length drawn in the tool's life, before this stroke", "m"),
        known("wet_age_s", pa.float32(), "ink-weighted median age of the paint under it; NaN = blank", "s"),
        known("measured_path", PATH, f"measured {_TIP}", "s, m, m, m, rad", "see `frame`", may_be_nan=(0,)),
        known("force_n", pa.list_(pa.float32()), "normal force at the points of `path`", "N"),
        known("window_px", vector(4), "the window in the raw camera frame", "px", "camera"),
        known("frame_size_px", pa.list_(pa.int32(), 2), "raw camera frame: width, height; 0 = unknown", "px"),
        known("exposure_s", pa.float32(), "of the camera", "s"),
        known("gain", pa.float32(), "of the camera"),
        known("white_balance", vector(3), "of the camera: factors on linear R, G, B"),
    ),
)

_PIXELS_PER_M: Final = 1000.0
_CANVAS_M: Final = (0.30, 0.20)
_WINDOW_M: Final = np.array([-0.012, -0.028, 0.068, 0.028])
_STROKES_PER_DIP: Final = 4


def example_table(n: int, seed: int = 0) -> pa.Table:
    """`n` plausible rows of one session: dark bent marks, wider where pressed, paler as the ink runs out.

    The last quarter repeats the first actions, so that a noise floor can be estimated.
    """
    rows: list[dict[str, Any]] = []
    drawn_m, since_dip_m, clock_s = 0.0, 0.0, 0.0
    singles = n - n // 4
    for order in range(n):
        if order % _STROKES_PER_DIP == 0:
            since_dip_m = 0.0
        action = order if order < singles else order - singles
        row, length_m = _example_row(action, order, since_dip_m, seed)
        duration_s = row["path"][-1][0]
        row |= {
            "t_before_s": clock_s,
            "t_start_s": clock_s + 1.0,
            "t_after_s": clock_s + duration_s + 2.0,
            "since_reload": order % _STROKES_PER_DIP,
            "reload_id": order // _STROKES_PER_DIP,
            "ink_since_reload_m": since_dip_m,
            "tool_age_m": drawn_m,
        }
        rows.append(row)
        drawn_m, since_dip_m, clock_s = drawn_m + length_m, since_dip_m + length_m, clock_s + duration_s + 3.0
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def _example_row(action: int, order: int, since_dip_m: float, seed: int) -> tuple[dict[str, Any], float]:
    plan, noise = np.random.default_rng([seed, action]), np.random.default_rng([seed, 1_000_000 + order])
    length_m, bend_m = plan.uniform(0.02, 0.055), plan.uniform(-0.015, 0.015)
    press_m, speed_m_s = plan.uniform(0.0005, 0.003), plan.uniform(0.02, 0.08)
    start_m = plan.uniform([0.02, 0.04], [_CANVAS_M[0] - 0.08, _CANVAS_M[1] - 0.04])
    s = np.linspace(0.0, 1.0, 32)
    local = np.stack([length_m * s, 4 * bend_m * s * (1 - s)], axis=1)
    z = -press_m * np.sin(np.pi * s) ** 0.5
    path = np.column_stack([s * length_m / speed_m_s, local + start_m, z, np.zeros_like(s)])

    window = _WINDOW_M + np.tile(start_m, 2)
    color_srgb = np.array([0.08, 0.08, 0.10])
    radius_m = 0.0008 + 0.6 * press_m
    before, after = _example_images(path, window, radius_m, since_dip_m=since_dip_m, color_srgb=color_srgb, noise=noise)
    row = {
        "session": f"example_{seed}",
        "order": order,
        "action_id": action,
        "tool": "round_brush",
        "path": path.tolist(),
        "window_m": window.tolist(),
        "before": {"bytes": encode_png(before), "path": None},
        "after": {"bytes": encode_png(after), "path": None},
        "frame": "canvas",
        "encoding": "srgb",
        "medium": "acrylic",
        "surface": "paper",
        "surface_id": "sheet_0",
        "tool_id": "brush_0",
        "camera_id": "camera_0",
        "color_srgb": color_srgb.tolist(),
        "previous_color_srgb": color_srgb.tolist() if order else [float("nan")] * 3,
        "session_start_unix_s": 1.75e9,
        "wet_age_s": float("nan"),
        "measured_path": (path + noise.normal(0, 1e-5, path.shape) * [0, 1, 1, 1, 0]).tolist(),
        "force_n": (-300.0 * z).tolist(),
        "window_px": (3000.0 * (window + 0.02)).tolist(),
        "frame_size_px": [1020, 720],
        "exposure_s": 0.01,
        "gain": 1.0,
        "white_balance": [1.0, 1.0, 1.0],
    }
    return row, float(np.linalg.norm(np.diff(local, axis=0), axis=1).sum())


def _example_images(
    path: npt.NDArray[np.float64],
    window: npt.NDArray[np.float64],
    radius_m: float,
    *,
    since_dip_m: float,
    color_srgb: npt.NDArray[np.float64],
    noise: np.random.Generator,
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Blank paper, and the same with a soft-edged ribbon along the path, both with camera noise."""
    height, width = image_shape(window, _PIXELS_PER_M)
    columns, rows = np.arange(width), np.arange(height)
    x = pixel_to_canvas(np.stack([columns, 0 * columns], axis=1), window, _PIXELS_PER_M)[:, 0]
    y = pixel_to_canvas(np.stack([0 * rows, rows], axis=1), window, _PIXELS_PER_M)[:, 1]
    squared = ((x - px) ** 2 + ((y - py) ** 2)[:, None] for px, py in path[:, 1:3])
    distance_m = np.sqrt(np.minimum.reduce(list(squared)))
    edge = np.clip(0.5 + (radius_m - distance_m) * _PIXELS_PER_M, 0.0, 1.0)
    coverage = (edge * np.exp(-since_dip_m / 0.5))[..., None]
    paper = srgb_to_linear(np.full((height, width, 3), 0.93))
    painted = (1 - coverage) * paper + coverage * srgb_to_linear(color_srgb)

    def photographed(linear: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
        return to_uint8(linear_to_srgb(linear) + noise.normal(0, 0.01, linear.shape))

    return photographed(paper), photographed(painted)
