"""Rows of the strokes contract as the diagnosis needs them: images of one size, covariates, actions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray

from pentimento.contracts import images
from pentimento.contracts.covariates import PICKUP_COLUMNS
from pentimento.diagnosis.strokes.executed import Following, executed
from pentimento.dynamics.strokes.paint_pickup import paint_pickup
from pentimento.dynamics.strokes.photometry import srgb_to_linear
from pentimento.dynamics.strokes.samples import TOLERANCE_PX, StrokeSamples, load_samples, resample_path
from pentimento.dynamics.strokes.simulation import StrokeContext

Array = NDArray[Any]

_POINTS = 24
"""Points of a resampled path."""
_LARGEST_SIDE_PX = 112
"""Images are averaged down to this size."""
_ROWS_AT_ONCE = 24
"""Strokes a batch."""
_FEWEST_BLOCKS = 12
"""With fewer loads of paint, each action is its own block."""
_FEWEST_OF_A_MIX = 8  # blocks
_NOT_COVARIATES = ("action_id",)
_NUMERIC = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal)
_FEW_MISSING = 0.1
"""Share of rows up to which missing covariate values are interpolated."""
_RESTARTING_WITH_EACH_LOAD = ("since_reload", "ink_since_reload_m")
"""Covariates that restart with each load of paint."""
_NAN_SAYS_SOMETHING = ("wet_age_s",)
"""Covariates whose NaN has a meaning: nothing was painted below."""

_IMAGES = ("before", "before_linear", "after", "ink", "valid")
"""Fields of samples that are images."""


@dataclass(frozen=True)
class Measured:
    """B strokes for comparison with predictions."""

    samples: StrokeSamples
    """``path`` is as executed: measured where the robot measured it (``executed``), otherwise as commanded."""
    command: torch.Tensor
    """float32[B, N, 5]: commanded paths."""
    following: Following | None
    """The robot's delay, which the executed paths hold; None where paths are as commanded."""
    press_from_force: bool
    """Whether the paths' press is in proportion to the measured force, because z does not vary."""
    covariates: dict[str, Array]
    """float64[B] each: every numeric scalar column but identities; NaN where unknown."""
    paint: Array
    """int64[B]: index of the distinct paint, by ``mixes``."""
    paints: int
    """Number of distinct paints in the whole table."""
    block: Array
    """int64[B]: session and load of paint."""
    turn: Array
    """int64[B]: rank in the order of execution, session by session."""
    painted: Array
    """float32[B, H, W]: how much paint there is before the stroke, 0 to 1."""
    weight: Array
    """float64[B]: weight of each stroke's squared error; 1 unless set by ``fit.huber_weighted``."""
    residual_prediction: Array
    """float32[B, H, W, 3], sRGB: prediction of the learned residual model, added to any model's prediction."""

    def __len__(self) -> int:
        return len(self.block)

    @property
    def action(self) -> Array:
        """int64[B]: rows of equal value repeat one command."""
        return self.samples.action.numpy()

    @cached_property
    def context(self) -> StrokeContext:
        """The strokes as mechanisms see them, [B, 1, ...]."""
        columns = {name: torch.tensor(v, dtype=torch.float64)[:, None] for name, v in self.covariates.items()}
        return StrokeContext(self.samples.path[:, None].double(), columns)

    def pick(self, rows: Array | slice) -> Measured:
        """The strokes with these indices; a slice copies nothing."""
        index = rows if isinstance(rows, slice) else torch.as_tensor(np.asarray(rows))
        kept = {name: values[rows] for name, values in self.covariates.items()}
        return replace(
            self, samples=self.samples.pick(index), command=self.command[index], covariates=kept,
            paint=self.paint[rows], block=self.block[rows], turn=self.turn[rows], painted=self.painted[rows],
            weight=self.weight[rows], residual_prediction=self.residual_prediction[rows],
        )  # fmt: skip

    @cached_property
    def batches(self) -> list[tuple[Array, Measured]]:
        """Indices of strokes with windows of about one size, and these strokes with no more padding than they need."""
        valid = self.samples.valid.numpy() > 0
        heights, widths = valid.any(2).sum(1), valid.any(1).sum(1)
        by_size = np.argsort(heights * widths, kind="stable")
        batches = [by_size[start : start + _ROWS_AT_ONCE] for start in range(0, len(self), _ROWS_AT_ONCE)]
        return [(rows, self.pick(rows)._cropped(heights[rows].max(), widths[rows].max())) for rows in batches]

    def _cropped(self, height: int, width: int) -> Measured:
        """The strokes with images of this size, which holds their windows."""
        inside = (slice(None), slice(height), slice(width))
        images = {name: getattr(self.samples, name)[inside] for name in _IMAGES}
        residual_prediction = self.residual_prediction[inside]
        samples = self.samples._replace(**images)
        return replace(self, samples=samples, painted=self.painted[inside], residual_prediction=residual_prediction)


def load_measured(table: pa.Table) -> Measured:
    """Load rows of the strokes contract as they were executed (``executed``).

    Photographs are averaged down to about a hundred pixels a side, ``before`` denoised.

    Raises:
        ContractError: the table has no rows, or a row (it is named) makes no sample.
    """
    pixels_per_m = common_resolution(table)
    near_m = TOLERANCE_PX / pixels_per_m
    commands = [resample_path(np.asarray(path, dtype=float), _POINTS, near_m) for path in table["path"].to_pylist()]
    table, following, press_from_force = executed(table)
    samples = load_samples(table, _POINTS, pixels_per_m, 1.0)
    before = torch.from_numpy(np.stack([_denoised(image) for image in samples.before.numpy()]))
    samples = samples._replace(before=before, before_linear=srgb_to_linear(before))
    block = _loads(table)
    if block.max() + 1 < _FEWEST_BLOCKS:  # a pen that is never dipped: each action by itself
        _, block = np.unique(samples.action.numpy(), return_inverse=True)
    painted = _painted(samples.before_linear.numpy())
    paint = mixes(samples.color.numpy(), _sessions(table), block)
    order = np.lexsort((np.asarray(table["order"].to_pylist()), np.asarray(table["session"].to_pylist())))
    columns, paints = covariates_of(table) | paint_pickup(table, samples), int(paint.max()) + 1
    nothing_learnt = np.zeros((*painted.shape, 3), np.float32)
    command = torch.tensor(np.array(commands), dtype=torch.float32)
    return Measured(
        samples,
        command,
        following,
        press_from_force,
        columns,
        paint,
        paints,
        block,
        np.argsort(order),
        painted,
        np.ones(len(samples.path)),
        nothing_learnt,
    )


def mixes(color_srgb: Array, session: Array, block: Array) -> Array:
    """Index of each stroke's paint, int[B]: its colour, by session where every session shows each colour in enough
    blocks.

    A paint that is mixed for each session varies a little. Without an offset for each mix, that would look like a
    drift over sessions, such as tool wear.

    Args:
        color_srgb: [B, 3].
        session: int[B].
        block: int[B].
    """
    color = np.unique(color_srgb.round(3), axis=0, return_inverse=True)[1].reshape(-1)
    mixed = np.unique(np.stack([session, color]), axis=1, return_inverse=True)[1].reshape(-1)
    fewest = min(len(np.unique(block[mixed == each])) for each in np.unique(mixed))
    return np.asarray(mixed if fewest >= _FEWEST_OF_A_MIX else color)


def covariates_of(table: pa.Table) -> dict[str, Array]:
    """Every numeric scalar column but identities, float64[B]; surfaces are numbered in the order of their names.

    Few missing values are interpolated in the order of execution, within a session, or within a load for columns that
    restart with each load.
    """
    found: dict[str, Array] = {}
    order = np.asarray(table["order"].to_pylist(), dtype=np.float64)
    session, load = _sessions(table), _loads(table)
    for field in table.schema:
        if field.name in _NOT_COVARIATES or (field.name.endswith("_id") and field.name != "surface_id"):
            continue
        if any(is_kind(field.type) for is_kind in _NUMERIC):
            # Whole numbers that a float rounds, such as nanoseconds of a clock, are covariates, too.
            column = table[field.name].cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            if np.isfinite(column).any():
                within = load if field.name in _RESTARTING_WITH_EACH_LOAD else session
                found[field.name] = _few_filled(field.name, np.array(column, dtype=np.float64), order, within)
    for name in ("surface", "surface_id"):
        if name in table.schema.names:
            levels = np.array([str(v) for v in table[name].to_pylist()])
            known, level = np.unique(levels, return_inverse=True)
            if 1 < len(known) <= len(levels) // 8:
                found.setdefault("surface_level", level.astype(np.float64))
    return found


def _sessions(table: pa.Table) -> Array:
    """Index of each row's session, int[B]."""
    return np.asarray(np.unique(table["session"].to_pylist(), return_inverse=True)[1])


def _loads(table: pa.Table) -> Array:
    """Index of each row's session and load of the tool, int[B]."""
    load = table["reload_id"].to_pylist() if "reload_id" in table.schema.names else [None] * table.num_rows
    names = [f"{session} {reload}" for session, reload in zip(table["session"].to_pylist(), load, strict=True)]
    return np.asarray(np.unique(names, return_inverse=True)[1])


def _few_filled(name: str, values: Array, order: Array, within: Array) -> Array:
    known = np.isfinite(values)
    if name in _NAN_SAYS_SOMETHING or known.all() or known.mean() < 1 - _FEW_MISSING:
        return values
    for group in np.unique(within[~known]):
        rows = np.flatnonzero(within == group)
        rows = rows[np.argsort(order[rows], kind="stable")]
        sure = rows[known[rows]]
        if len(sure):
            values[rows] = np.interp(order[rows], order[sure], values[sure])
    return values


def common_resolution(table: pa.Table) -> float:
    """Pixels a metre at which no window has a side longer than ``_LARGEST_SIDE_PX``."""
    finest = np.inf
    for window, before in zip(table["window_m"].to_pylist(), table["before"].to_pylist(), strict=True):
        height, width = images.png_shape(before["bytes"])
        scale = width / max(window[2] - window[0], 1e-9)
        finest = min(finest, scale / max(np.ceil(max(height, width) / _LARGEST_SIDE_PX), 1.0))
    return float(finest)


def _painted(before_linear: Array) -> Array:
    """Amount of paint from the difference to each window's paper, [B, H, W]."""
    paper = np.quantile(before_linear, 0.9, axis=(1, 2), keepdims=True).astype(np.float32)
    return np.clip(np.abs(before_linear - paper).max(-1) / 0.15, 0.0, 1.0)


def _denoised(image: Array) -> Array:
    """A photograph [H, W, 3] without its pixel noise, edges kept: noise in ``before`` resembles an effect of the paint
    below (docs/diagnosis.md §3).
    """
    grey = image.mean(-1)
    # Immerkaer's noise estimate: its mask does not respond to planes and straight edges.
    mask = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
    noise = float(np.median(np.abs(cv2.filter2D(grey, -1, mask)))) / 0.6745 / 6
    if noise < 1e-4:
        return image
    return np.asarray(cv2.bilateralFilter(image.astype(np.float32), 5, 4 * noise * 1.7, 1.5), dtype=np.float32)


def covariates_shown(measured: Measured) -> dict[str, Array]:
    """Recorded and path covariates that are known for all strokes and vary, float64[B] each; of paint pickup only the
    amount.
    """
    recorded = {name: values for name, values in measured.covariates.items() if name not in PICKUP_COLUMNS[1:]}
    known = {name: values for name, values in recorded.items() if np.isfinite(values).all() and np.ptp(values) > 1e-9}
    return known | path_covariates(measured)


def path_covariates(measured: Measured) -> dict[str, Array]:
    """Covariates of the executed path that vary (length, press, heading, place, speed), float64[B] each."""
    path = measured.samples.path.double().numpy()
    steps = np.hypot(*np.diff(path[..., 1:3], axis=1).transpose(2, 0, 1))
    chord = path[:, -1, 1:3] - path[:, 0, 1:3]
    heading = np.arctan2(chord[:, 1], chord[:, 0])
    found = {
        "length_m": steps.sum(1),
        "press_m": np.maximum(-path[..., 3], 0).mean(1),
        "heading_cos": np.cos(heading),
        "heading_sin": np.sin(heading),
        "place_x_m": path[..., 1].mean(1),
        "place_y_m": path[..., 2].mean(1),
    }
    duration = path[:, -1, 0] - path[:, 0, 0]
    if np.isfinite(duration).all() and (duration > 0).all():
        found["speed_m_s"] = found["length_m"] / duration
    return {name: values for name, values in found.items() if np.ptp(values) > 1e-6}
