"""The `pushes` table: one row for each push or pinch into clay, or pellet placed on it, measured or simulated."""

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pentimento.contracts.frames import canvas_to_stroke, image_shape, pixel_to_canvas
from pentimento.contracts.height_maps import encode_height_png
from pentimento.contracts.schema import IMAGE, TableContract, arrow_schema, known, needed, vector

PLACE: Final = "place"
KINDS: Final = ("push", "pinch", PLACE)

_ACTION = (
    "x, y, theta, length of travel (pinch: closing), depth: relative to the surface at the start, "
    "ramping from 0 to depth at the end of travel; place: x, y of the pellet, then zeros"
)

CONTRACT: Final = TableContract(
    name="pushes",
    description="One row for each push or pinch into a soft material, or pellet placed on it, measured or simulated.",
    columns=(
        needed("session", pa.string(), "one uninterrupted recording: same tool, material, scanner pose"),
        needed("order", pa.int32(), "execution order in the session"),
        needed("action_id", pa.int32(), "rows of one value repeat the same commanded action"),
        needed("tool", pa.string(), "name of the end-effector"),
        needed("material", pa.string(), "name of the material, e.g. foam"),
        needed("kind", pa.string(), "push, pinch, or place: a pellet set on the surface", choices=KINDS),
        needed("action", vector(5), _ACTION, "m, m, rad, m, m", "canvas"),
        needed("window_m", vector(4), "x_min, y_min, x_max, y_max of both images", "m", "canvas"),
        needed("before", IMAGE, "16-bit PNG of height above the table before; 0 = hole", "", "image"),
        needed("after", IMAGE, "16-bit PNG of height above the table after; 0 = hole", "", "image"),
        needed("height_per_unit_m", pa.float32(), "height of one unit of the images", "m"),
        known("surface_height_m", pa.float32(), "height of the undeformed surface above the table", "m"),
        known("speed_m_s", pa.float32(), "speed of travel", "m/s"),
        known("retract_speed_m_s", pa.float32(), "speed of lifting the tool", "m/s"),
        known("dwell_s", pa.float32(), "rest at the end of travel", "s"),
        known("reset_id", pa.int32(), "which time the material was smoothed"),
        known("pushes_since_reset", pa.int32(), "pushes since the material was smoothed; 0 = first"),
        known("t_start_s", pa.float64(), "start of the push since the session's start", "s"),
        known("t_before_s", pa.float64(), "time of the scan before, since the session's start", "s"),
        known("t_after_s", pa.float64(), "time of the scan after, since the session's start", "s"),
        known("table_plane", vector(3), "a, b, c of the table's height a x + b y + c in the scan", "1, 1, m"),
        known("scanner_id", pa.string(), "which scanner"),
        known("tool_id", pa.string(), "which specimen of the tool"),
        known("volume_m3", pa.float32(), "place: volume of the pellet", "m^3"),
        known("force_n", pa.list_(pa.float32()), "force along the push", "N"),
    ),
)

_PIXELS_PER_M: Final = 500.0
_HEIGHT_PER_UNIT_M: Final = 1e-6
_SURFACE_M: Final = 0.04
_WINDOW_M: Final = np.array([0.0, 0.0, 0.12, 0.12])
_TOOL_RADIUS_M: Final = 0.008
_PUSHES_PER_RESET: Final = 5


def example_table(n: int, seed: int = 0) -> pa.Table:
    """`n` plausible pushes into a slab that is smoothed every few pushes; row i depends on (seed, i) only."""
    rows = [_example_row(order, seed) for order in range(n)]
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def _example_row(order: int, seed: int) -> dict[str, Any]:
    generator = np.random.default_rng([seed, order])
    action = generator.uniform([0.03, 0.03, -math.pi, 0.0, 0.003], [0.09, 0.09, math.pi, 0.025, 0.012])
    shape = image_shape(_WINDOW_M, _PIXELS_PER_M)
    before = _SURFACE_M + generator.normal(0.0, 1e-4, shape)
    after = before + _dent_m(action) + generator.normal(0.0, 1e-4, shape)
    return {
        "session": f"example_{seed}",
        "order": order,
        "action_id": order,
        "tool": "ball",
        "material": "foam",
        "kind": "push",
        "action": action.tolist(),
        "window_m": _WINDOW_M.tolist(),
        "before": {"bytes": encode_height_png(before, _HEIGHT_PER_UNIT_M), "path": None},
        "after": {"bytes": encode_height_png(after, _HEIGHT_PER_UNIT_M), "path": None},
        "height_per_unit_m": _HEIGHT_PER_UNIT_M,
        "surface_height_m": _SURFACE_M,
        "speed_m_s": 0.02,
        "retract_speed_m_s": 0.05,
        "dwell_s": 0.5,
        "reset_id": order // _PUSHES_PER_RESET,
        "pushes_since_reset": order % _PUSHES_PER_RESET,
        "t_before_s": 10.0 * order,
        "t_start_s": 10.0 * order + 2.0,
        "t_after_s": 10.0 * order + 8.0,
        "table_plane": [0.0, 0.0, 0.0],
        "scanner_id": "scanner_0",
        "tool_id": "ball_0",
    }


def _dent_m(action: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Change of height [H, W]: a groove that deepens along the travel, with a low rim beside it."""
    x_m, y_m, theta_rad, length_m, depth_m = action
    height, width = image_shape(_WINDOW_M, _PIXELS_PER_M)
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    local = canvas_to_stroke(pixel_to_canvas(pixels, _WINDOW_M, _PIXELS_PER_M), x_m, y_m, theta_rad)
    along = np.clip(local[..., 0], 0.0, length_m)
    distance = np.hypot(local[..., 0] - along, local[..., 1]) / _TOOL_RADIUS_M
    deepening = 0.3 + 0.7 * along / max(length_m, 1e-6)
    rim = 0.15 * np.exp(-(((distance - 1.4) / 0.3) ** 2))
    return np.asarray(depth_m * deepening * (rim - np.sqrt(np.clip(1.0 - distance**2, 0.0, None))))
