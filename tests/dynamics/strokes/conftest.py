"""Strokes made by a known Traj2Stroke, so that fitting it again must find it."""

import numpy as np
import pyarrow as pa
import pytest
import torch

from pentimento.contracts.colour import to_uint8
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.dynamics.strokes.evaluation import predict
from pentimento.dynamics.strokes.samples import StrokeSamples, load_samples
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters
from pentimento.robots.strokes import stroke_points

TRUTH = Traj2StrokeParameters((0.9, 0.92), (5e-4, -4e-4), 0.8, 1.5e-3, 0.2, 0.95)
WINDOW_M = [0.01, 0.02, 0.07, 0.06]


def stroke_row(path: np.ndarray, before: np.ndarray, after: np.ndarray, action: int) -> dict[str, object]:
    return {
        "session": "s",
        "order": action,
        "action_id": action,
        "tool": "brush",
        "path": path.tolist(),
        "window_m": WINDOW_M,
        "before": {"bytes": encode_png(before), "path": None},
        "after": {"bytes": encode_png(after), "path": None},
        "color_srgb": [0.1, 0.1, 0.2],
    }


def table(rows: list[dict[str, object]]) -> pa.Table:
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))


@pytest.fixture(scope="session")
def made_by_truth() -> StrokeSamples:
    """24 strokes in a 60 x 40 mm window at 1 px/mm, drawn by TRUTH on white paper."""
    rng = np.random.default_rng(0)
    white = np.full((40, 60, 3), 255, np.uint8)
    rows = []
    for action in range(24):
        points = stroke_points(
            np.array([rng.uniform(0.03, 0.05), rng.uniform(0.035, 0.045)]),
            rng.uniform(-np.pi, np.pi),
            rng.uniform(0.01, 0.025),
            bend_m=rng.uniform(-0.004, 0.004),
            press_m=rng.uniform(2e-4, 3e-3, 3),
            yaw_rad=0.0,
            points=12,
        )
        path = np.column_stack([np.linspace(0, 1, 12), points])
        rows.append(stroke_row(path, white, white, action))
    blank = load_samples(table(rows), 12, 1000.0, 0.05)
    with torch.no_grad():
        after = to_uint8(predict(Traj2Stroke(TRUTH), blank).numpy())
    for row, image in zip(rows, after, strict=True):
        row["after"] = {"bytes": encode_png(image), "path": None}
    return load_samples(table(rows), 12, 1000.0, 0.05)
