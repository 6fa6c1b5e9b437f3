"""Rows of the ``strokes`` contract as tensors: resampled paths, padded images, and the pixels that a stroke inked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray
from torch import Tensor

from pentimento.contracts import frames, images
from pentimento.contracts.colour import to_float
from pentimento.contracts.errors import ContractError, ImageError, PentimentoError
from pentimento.dynamics.strokes.photometry import srgb_to_linear
from pentimento.dynamics.strokes.resolution import AUTO, Auto, RowExtent, Sampling, choose_sampling
from pentimento.dynamics.strokes.simulation import View

Array = NDArray[Any]
T = TypeVar("T")

INK_THRESHOLD = 110 / 255
"""Share of the full contrast between paper and paint above which a pixel counts as inked."""
TOLERANCE_PX = 0.5
"""Distance by which a resampled path may leave its path."""
_FINE = 8
"""Times as many points where bends are looked for."""
_OF_BENDS = 3.0
"""Weight of bends in the density of points; that of length is 1."""
_VISIBLE = 0.02  # squared sRGB distance between paint and ground below which a mark cannot be seen


class StrokeSamples(NamedTuple):
    """B measured strokes. Images are padded to one size; ``valid`` is 0 in the padding."""

    path: Tensor  # [B, N, 5] t_s, x_m, y_m, z_m, yaw_rad, as from `resample_path`
    top_left_m: Tensor  # [B, 2] x_min, y_max of each image's window
    pixels_per_m: Tensor  # [B]
    before: Tensor  # [B, H, W, 3] sRGB
    before_linear: Tensor  # [B, H, W, 3] the same in linear light
    after: Tensor  # [B, H, W, 3] sRGB, without ink that does not touch the stroke
    color: Tensor  # [B, 3] sRGB of the paint
    ink: Tensor  # [B, H, W] bool: pixels that the stroke inked
    valid: Tensor  # [B, H, W]
    action: Tensor  # [B] int64: rows of one value repeat the same command

    def pick(self, index: Tensor | slice) -> StrokeSamples:
        """The samples with these indices."""
        return StrokeSamples(*(field[index] for field in self))

    @property
    def view(self) -> View:
        """Which part of the canvas each image shows."""
        return View(self.top_left_m, self.pixels_per_m)


def load_samples(table: pa.Table, points: int, pixels_per_m: float | Auto, margin_m: float | Auto) -> StrokeSamples:
    """Turn rows of the ``strokes`` contract into tensors.

    Paths are resampled to ``points`` points, images finer than ``pixels_per_m`` are averaged down to about that, and
    windows are trimmed to ``margin_m`` around the commanded path. "auto" is the choice of ``sampling_of``.

    Ink that does not touch the commanded path (of neighbouring strokes) is reset to ``before``.

    Raises:
        ContractError: the table has no rows, a row (it is named) makes no sample, or "auto" finds no ink.
    """
    if AUTO in (pixels_per_m, margin_m):
        chosen = sampling_of(table, pixels_per_m, margin_m)
        pixels_per_m, margin_m = chosen.pixels_per_m, chosen.margin_m
    scale, margin = float(pixels_per_m), float(margin_m)
    shown = zip(table["before"], table["window_m"], strict=True)
    scales = [images.recorded_pixels_per_m(before.as_py(), window.as_py()) for before, window in shown]
    coarser = frames.coarsening(scales, scale)
    loaded = _each_row(table, lambda n, row: _load_row(row, points, int(coarser[n]), margin_m=margin))
    height = max(one.before.shape[0] for one in loaded)
    width = max(one.before.shape[1] for one in loaded)

    def pad(image: Array) -> Array:
        extra = ((0, height - image.shape[0]), (0, width - image.shape[1])) + ((0, 0),) * (image.ndim - 2)
        return np.pad(image, extra)

    def tensor(arrays: list[Array]) -> Tensor:
        return torch.from_numpy(np.stack(arrays).astype(np.float32))

    before_srgb, after_srgb = tensor([pad(one.before) for one in loaded]), tensor([pad(one.after) for one in loaded])
    color_srgb = tensor([one.color for one in loaded])
    return StrokeSamples(
        path=tensor([one.path for one in loaded]),
        top_left_m=tensor([one.top_left_m for one in loaded]),
        pixels_per_m=torch.tensor([one.pixels_per_m for one in loaded], dtype=torch.float32),
        before=before_srgb,
        before_linear=srgb_to_linear(before_srgb),
        after=after_srgb,
        color=color_srgb,
        ink=inked_share(before_srgb, after_srgb, color_srgb[:, None, None]) > INK_THRESHOLD,
        valid=tensor([pad(np.ones(one.before.shape[:2])) for one in loaded]),
        action=torch.tensor(table["action_id"].to_pylist()),
    )


def sampling_of(table: pa.Table, pixels_per_m: float | Auto, margin_m: float | Auto) -> Sampling:
    """The resolution and the margin at which ``load_samples`` reads a table.

    Raises:
        ContractError: as ``load_samples``.
    """
    return choose_sampling(_each_row(table, lambda _, row: _extent(row)), pixels_per_m, margin_m)


def _each_row(table: pa.Table, read: Callable[[int, dict[str, object]], T]) -> list[T]:
    """Read every row, one after another; an error names its row."""
    if table.num_rows == 0:
        raise ContractError("The strokes table has no rows: collect strokes first, or check its quarantine report.")
    found = []
    for number, row in enumerate(row for batch in table.to_batches() for row in batch.to_pylist()):
        try:
            found.append(read(number, row))
        except PentimentoError as error:
            raise ContractError(f"Row {number} of the strokes table: {error}") from error
    return found


def inked_share(before: Tensor, after: Tensor, color: Tensor) -> Tensor:
    """Fraction of the change from ``before`` to the paint's ``color`` at each pixel; all sRGB [..., 3].

    0 is untouched, 1 full paint. It is 0 where the paint has the colour of the ground.
    """
    contrast = color - before
    power = contrast.square().sum(-1)
    moved = ((after - before) * contrast).sum(-1)
    return torch.where(power > _VISIBLE, moved / power.clamp(min=_VISIBLE), 0.0)


def resample_path(path: Array, points: int, tolerance_m: float = math.inf) -> Array:
    """[M, 5] to [points, 5] at equal steps of arc length; a path that does not move is stepped by index.

    Where such steps would leave the path by more than ``tolerance_m``, as in handwriting, steps are smaller in bends.
    """
    steps = np.hypot(*np.diff(path[:, 1:3], axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    if along[-1] <= 0:
        along = np.arange(len(path), dtype=float)
    at = np.linspace(0, along[-1], points)
    columns = [*path[:, :4].T, np.unwrap(path[:, 4])]  # a yaw may jump from half a turn to minus half a turn
    even = np.stack([np.interp(at, along, column) for column in columns], axis=1)
    if _distance_m(path[:, 1:3], even[:, 1:3]) <= tolerance_m:
        return even
    fine = resample_path(path, _FINE * points)
    step = np.diff(fine[:, 1:3], axis=0)
    turned = np.abs(np.gradient(np.unwrap(np.arctan2(step[:, 1], step[:, 0]))))
    turned = np.convolve(turned, np.full(3, 1 / 3), "same")
    # A chord leaves its arc by (step length)² × curvature / 8, so equal errors need a density of √curvature.
    bent = np.sqrt(turned)
    measure = np.concatenate([[0.0], np.cumsum(1 / len(step) + _OF_BENDS * bent / max(bent.sum(), 1e-12))])
    at = np.linspace(0, measure[-1], points)
    return np.stack([np.interp(at, measure, column) for column in fine.T], axis=1)


def _distance_m(points: Array, line: Array) -> float:
    """Largest distance of points [M, 2] from a polyline [N, 2]."""
    start, step = line[:-1], np.diff(line, axis=0)
    away = points[:, None] - start
    share = np.clip((away * step).sum(-1) / np.maximum((step**2).sum(-1), 1e-18), 0.0, 1.0)
    return float(np.linalg.norm(away - share[..., None] * step, axis=-1).min(1).max())


@dataclass(frozen=True)
class _Row:
    """One row, its window cut to the stroke."""

    path: Array
    """[N, 5]."""
    before: Array
    """[H, W, 3], sRGB in [0, 1]."""
    after: Array
    color: Array
    """[3], sRGB."""
    top_left_m: Array
    """[2], canvas frame."""
    pixels_per_m: float


def _load_row(row: dict[str, object], points: int, coarser: int, *, margin_m: float) -> _Row:
    path, before, after, color, window = _pictures(row, margin_m)
    scale = frames.pixels_per_m(before.shape[:2], window)
    _, touched = _ink(path, before, after, color=color, window=window)
    after = np.where(touched[..., None], after, before)
    before, after, scale = _averaged(before, coarser), _averaged(after, coarser), float(scale / coarser)
    resampled = resample_path(path, points, TOLERANCE_PX / scale)
    return _Row(resampled, before, after, color, window[[0, 3]], scale)


def row_ink(row: dict[str, object]) -> tuple[Array, Array, float, Array]:
    """Of a row: its path [N, 5], the share of paint at each pixel [H, W], pixels a metre, and the window [4]."""
    path, before, after, color, window = _pictures(row, None)
    scale = frames.pixels_per_m(before.shape[:2], window)
    return path, _ink(path, before, after, color=color, window=window)[0], scale, window


def _extent(row: dict[str, object]) -> RowExtent:
    path, before, after, color, window = _pictures(row, None)
    scale = frames.pixels_per_m(before.shape[:2], window)
    share, touched = _ink(path, before, after, color=color, window=window)
    (left, low), (right, high) = path[:, 1:3].min(0), path[:, 1:3].max(0)
    return RowExtent(
        length_m=float(np.hypot(*np.diff(path[:, 1:3], axis=0).T).sum()),
        ink_m2=float(((share > INK_THRESHOLD) & touched).sum() / scale**2),
        pixels_per_m=scale,
        size_m=(float(right - left), float(high - low)),
        paper_m=(
            float(left - window[0]), float(window[2] - right), float(low - window[1]), float(window[3] - high),
        ),
    )  # fmt: skip


def _pictures(row: dict[str, object], margin_m: float | None) -> tuple[Array, Array, Array, Array, Array]:
    """Path [N, 5], photographs before and after [H, W, 3], colour [3] and window [4], trimmed to the margin if any."""
    path = np.asarray(row["path"], dtype=float)
    window = np.asarray(row["window_m"], dtype=float)
    color = row.get("color_srgb")
    color = np.zeros(3) if color is None else np.asarray(color, dtype=float)
    color = color if np.isfinite(color).all() else np.zeros(3)  # NaN, like null, is unknown: taken as black
    before, after = (_read_image(row[name], row.get("encoding")) for name in ("before", "after"))
    if margin_m is None:
        return path, before, after, color, window
    trimmed = frames.snap_window(frames.window_around(path, margin_m), window, before.shape)
    return path, frames.crop(before, window, trimmed), frames.crop(after, window, trimmed), color, trimmed


def _ink(path: Array, before: Array, after: Array, *, color: Array, window: Array) -> tuple[Array, Array]:
    """Share of the paint at each pixel [H, W], and which pixels this stroke may have changed."""
    share = inked_share(*(torch.from_numpy(np.asarray(x, dtype=np.float32)) for x in (before, after, color))).numpy()
    scale = frames.pixels_per_m(before.shape[:2], window)
    return share, _ink_of_this_stroke(share, frames.canvas_to_pixel(path[:, 1:3], window, scale))


def _averaged(image: Array, factor: int) -> Array:
    """Means over blocks of factor × factor pixels; what does not fill a block at the right and bottom is left out."""
    height, width = (side // factor * factor for side in image.shape[:2])
    blocks = image[:height, :width].reshape(height // factor, factor, width // factor, factor, -1)
    mean: Array = blocks.mean(axis=(1, 3))
    return mean


def _read_image(stored: object, encoding: object) -> Array:
    image = images.decode_png(stored["bytes"])  # type: ignore[index]
    if image.dtype != np.uint8:
        raise ImageError(f"its photograph has {image.dtype} pixels; save it again with 8 bits.")
    if encoding == "ink":
        image = images.ink_encoded_to_srgb(image)
    return to_float(image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=-1))


def _ink_of_this_stroke(share: Array, path_px: Array) -> Array:
    """Which pixels may have been changed by the stroke: all but inked patches that the commanded path does not meet."""
    inked = (share > INK_THRESHOLD).astype(np.uint8)
    _, label = cv2.connectedComponents(inked, connectivity=8)
    on_path = np.zeros_like(inked)
    # A mark may be offset from its command: a path drawn 8 px wide still meets it.
    cv2.polylines(on_path, [np.round(path_px).astype(np.int32)], False, 1, thickness=8)
    met = np.unique(label[(on_path > 0) & (inked > 0)])
    foreign = (inked > 0) & ~np.isin(label, met)
    halo = cv2.dilate(foreign.astype(np.uint8), np.ones((5, 5), np.uint8))
    return (halo == 0) | np.isin(label, met[met > 0])
