"""Recording: an executed stroke becomes a row of the `strokes` contract."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.calibration.observe import CameraCalibration, Image, window_in_camera
from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import pixels_per_m
from pentimento.contracts.images import encode_png
from pentimento.contracts.photo import Photo
from pentimento.control.execute import ExecutedStroke, Session
from pentimento.robots.tools import Tool

FloatArray = NDArray[np.float64]


def record_stroke(
    session: Session,
    order: int,
    action_id: int,
    tool: Tool,
    executed: ExecutedStroke,
    window_m: FloatArray,
    before: Image,
    after: Image,
    photo_before: Photo,
    photo_after: Photo,
    calibration: CameraCalibration,
) -> dict[str, Any]:
    """One row of the `strokes` contract, in its Python form (`pyarrow.Table.from_pylist` takes it).

    `before` and `after` are uint8 sRGB [H, W, 3], rectified from the two photos to `window_m` (canvas
    frame). What was not measured is null. Identities (surface, camera, …) and further covariates are the
    caller's to add: `row | {"temperature_c": 21.5}`.

    Raises ContractError if the images differ in shape or do not fit the window.
    """
    if before.shape != after.shape:
        raise ContractError(f"The image before is {before.shape} and after {after.shape}; rectify both alike.")
    pixels_per_m(before.shape, window_m)
    event = executed.event
    measured = executed.measured_path
    return {
        "session": session.name,
        "order": order,
        "action_id": action_id,
        "tool": tool.name,
        "medium": tool.medium,
        "path": event.path.tolist(),
        "window_m": [float(value) for value in window_m],
        "before": {"bytes": encode_png(before), "path": None},
        "after": {"bytes": encode_png(after), "path": None},
        "frame": "canvas",
        "encoding": "srgb",
        "color_srgb": [float(value) for value in event.color_srgb],
        "t_start_s": event.t_start_s,
        "t_before_s": photo_before.t_s - session.started_s,
        "t_after_s": photo_after.t_s - session.started_s,
        **executed.covariates,
        "measured_path": measured.tolist() if np.all(np.isfinite(measured[:, 1:])) else None,
        "window_px": window_in_camera(calibration, window_m).tolist(),
        "frame_size_px": list(calibration.frame_size_px),
        "exposure_s": photo_after.exposure_s,
        "gain": photo_after.gain,
        "white_balance": [float(value) for value in photo_after.white_balance],
    }
