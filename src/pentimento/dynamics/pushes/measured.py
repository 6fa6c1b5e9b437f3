"""Rows of the ``pushes`` contract as arrays: heights in metres on one pixel size, holes filled, the table's tilt
removed.

Three repairs are made and counted. Holes are filled from their measured neighbours; they stay marked and never count in
a loss or a metric. The reported tilt of the table is subtracted from both scans. Rows that are unusable, or copies
of an earlier row, are left out. More unusable rows than the contract allows are an error.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pentimento.contracts import frames
from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.frames import coarsening
from pentimento.contracts.height_maps import decode_height_m, level, surface_at_m
from pentimento.contracts.images import recorded_pixels_per_m
from pentimento.contracts.pushes import PLACE
from pentimento.contracts.tables import MAX_BAD_SHARE, reason_list, row_fingerprint, row_list
from pentimento.planning.pushes.holes import fill_holes

_MAX_LENGTH_M = 1.0
"""No slab on a table is as high and no push as long: larger numbers must be in millimetres."""
_MAX_HOLES = 0.5
"""Maximum share of holes in a scan."""
_NOT_COVARIATES = ("action_id", "height_per_unit_m")
"""Numeric columns that are not covariates."""


class PushSamples(NamedTuple):
    """N measured pushes on one pixel size; all images are padded, at right and bottom, to one height and width."""

    before: NDArray[np.float32]
    """[N, H, W] height above the table in metres, row 0 at the top; holes filled."""
    after: NDArray[np.float32]
    """[N, H, W], likewise."""
    known: NDArray[np.bool_]
    """[N, H, W]: measured in both scans. Only these pixels count in losses and metrics."""
    action: NDArray[np.float64]
    """[N, 5] x_m, y_m, theta_rad, length_m (pinch: closing), depth_m; canvas frame."""
    window_m: NDArray[np.float64]
    """[N, 4] of the padded images."""
    pixels_per_m: float
    action_id: NDArray[np.int64]
    """[N]: rows of one value repeat the same command."""
    surface_m: NDArray[np.float64]
    """[N]: height at the start, from which the depth counts, as the robot reads it from the scan before."""
    session: NDArray[np.str_]
    tool: NDArray[np.str_]
    material: NDArray[np.str_]
    kind: NDArray[np.str_]
    """[N] each."""
    covariates: dict[str, NDArray[np.float64]]
    """[N] of each other numeric column, NaN where unknown; "order" is among them."""

    def pick(self, index: NDArray[Any] | slice) -> PushSamples:
        """The samples with these indices, or where a mask [N] is true."""
        kept = {name: values[index] for name, values in self.covariates.items()}
        arrays = {
            name: values[index] for name, values in self._asdict().items() if name not in ("covariates", "pixels_per_m")
        }
        return self._replace(**arrays, covariates=kept)


class Repairs(NamedTuple):
    """Repairs made to a table before it became samples."""

    rows: int
    """Rows of the table as given."""
    bad: dict[int, str]
    """Row number of each unusable row, and the reason."""
    copies: tuple[int, ...]
    """Rows that duplicate an earlier row. They would count as repeats without noise."""
    tilted: int
    """Number of samples from whose scans the reported tilt was subtracted."""
    holes: float
    """Share of the pixels that were not measured in both scans."""

    def sentences(self) -> list[str]:
        """The repairs as sentences for the report."""
        sentences = []
        if self.bad:
            sentences.append(f"{row_list(list(self.bad))} cannot be used and left out: {reason_list(self.bad)}.")
        if self.copies:
            sentences.append(f"{row_list(list(self.copies))} repeat an earlier row exactly and are left out.")
        if self.tilted:
            sentences.append(f"The table's reported tilt was taken off the scans of {self.tilted} rows.")
        if self.holes:
            sentences.append(f"{self.holes:.2%} of the pixels are holes; they were filled and count in no score.")
        return sentences


class _Row(NamedTuple):
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    action: NDArray[np.float64]
    window_m: NDArray[np.float64]
    pixels_per_m: float
    surface_m: float
    tilted: bool


def load_pushes(table: pa.Table, pixels_per_m: float = math.inf) -> tuple[PushSamples, Repairs]:
    """Pushes and pinches of a table that keeps the ``pushes`` contract, as arrays, and the repairs made.

    Placed pellets are no pushes and are skipped (``planning.pushes.place_fit`` reads them).

    Args:
        pixels_per_m: finer scans are averaged down, by one whole factor, to about this.

    Raises:
        ContractError: there is no row, more than 1 % of the rows (and more than one) are unusable, or they differ in
            pixel size.
    """
    table = table.filter(pc.not_equal(table["kind"], PLACE))
    if table.num_rows == 0:
        raise ContractError("The pushes table has no rows: collect pushes first, or check its quarantine report.")
    loaded: dict[int, _Row] = {}
    bad: dict[int, str] = {}
    copies: list[int] = []
    seen: set[bytes] = set()
    shown = zip(table["before"], table["window_m"], strict=True)
    scales = [recorded_pixels_per_m(before.as_py(), window.as_py()) for before, window in shown]
    factors = coarsening(scales, pixels_per_m)
    for number in range(table.num_rows):
        row = table.slice(number, 1).to_pylist()[0]
        try:
            sample = _load_row(row, int(factors[number]))
        except PentimentoError as error:
            bad[number] = str(error)
            continue
        fingerprint = row_fingerprint(row, "action")
        if fingerprint in seen:
            copies.append(number)
            continue
        seen.add(fingerprint)
        loaded[number] = sample
    if len(bad) > max(1, math.floor(MAX_BAD_SHARE * table.num_rows)) or 0 < len(bad) == table.num_rows:
        raise ContractError(
            f"{len(bad)} of {table.num_rows} rows of the pushes table cannot be used ({row_list(list(bad))}): "
            f"{reason_list(bad)}. Record them again or take them out; at most 1 % of the rows is left out."
        )
    samples = _stacked(list(loaded.values()), table.take(list(loaded)))
    tilted = sum(sample.tilted for sample in loaded.values())
    return samples, Repairs(table.num_rows, bad, tuple(copies), tilted, float(1 - samples.known.mean()))


def _load_row(row: dict[str, Any], factor: int) -> _Row:
    action = np.asarray(row["action"], dtype=np.float64)
    window = np.asarray(row["window_m"], dtype=np.float64)
    _check_action(action, row["kind"], window)
    before, after = (decode_height_m(row[name]["bytes"], row["height_per_unit_m"]) for name in ("before", "after"))
    tilted = _subtract_plane((before, after), window, row.get("table_plane"))
    for name, height in (("before", before), ("after", after)):
        holes = float(np.isnan(height).mean())
        if holes > _MAX_HOLES:
            raise ContractError(
                f"{holes:.0%} of its scan {name} are holes, and at most {_MAX_HOLES:.0%} may be (a scan made of points "
                f"needs pixels of about {_dense_mm(holes, frames.pixels_per_m(height.shape, window)):.2g} mm)"
            )
        if not abs(float(np.nanmedian(height))) < _MAX_LENGTH_M:
            raise ContractError(
                f"its heights {name} are about {float(np.nanmedian(height)):.3g} m: give height_per_unit_m in metres, "
                "not millimetres"
            )
    # From the scan before at full resolution, as the robot read it; holes of the scan after do not matter here.
    surface_m = surface_at_m(before, tuple(window), action[0], action[1])
    scale = frames.pixels_per_m(before.shape, window)
    height, width = (side // factor * factor for side in before.shape)
    kept = window + np.array([0.0, (before.shape[0] - height) / scale, (width - before.shape[1]) / scale, 0.0])
    before, after = _averaged(before, factor), _averaged(after, factor)
    return _Row(before, after, action, kept, scale / factor, surface_m, tilted)


def _dense_mm(holes: float, pixels_per_m: float) -> float:
    """Pixels of which a fifth would be holes, if the points of a scan with this share of holes are spread evenly.

    Pixels of side s without a point have the share exp(-density s²).
    """
    if holes >= 1:
        return math.inf
    return 1000 / pixels_per_m * math.sqrt(math.log(0.2) / math.log(holes))


def _check_action(action: NDArray[np.float64], kind: str, window: NDArray[np.float64]) -> None:
    x, y, theta, length, depth = action
    if min(length, depth) < 0:
        raise ContractError("its action has a negative length or depth")
    if max(length, depth) >= _MAX_LENGTH_M:
        raise ContractError(f"its action goes {length:.3g} m far and {depth:.3g} m deep: give metres, not millimetres")
    travel = length if kind == "push" else 0.0
    ends = np.array([[x, y], [x + travel * math.cos(theta), y + travel * math.sin(theta)]])
    if (ends < window[:2]).any() or (ends > window[2:]).any():
        raise ContractError("its action leaves the window that its scans show")


def _subtract_plane(heights: tuple[NDArray[np.float64], ...], window: NDArray[np.float64], plane: Any) -> bool:
    """Subtract the table's plane (a, b, c) from the heights, in place; return whether there was one."""
    if plane is None or not np.isfinite(np.asarray(plane, dtype=np.float64)).all() or not np.any(plane):
        return False
    for height in heights:
        height[...] = level(height, window, plane)
    return True


def _averaged(height_m: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """Means over blocks of factor × factor pixels; a block of which less than half was measured is a hole."""
    if factor == 1:
        return height_m
    rows, columns = (side // factor for side in height_m.shape)
    blocks = height_m[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(count >= factor**2 / 2, total / np.maximum(count, 1), np.nan)


def _stacked(rows: list[_Row], table: pa.Table) -> PushSamples:
    scales = np.array([row.pixels_per_m for row in rows])
    scale = float(np.median(scales))
    if np.abs(scales / scale - 1).max() > 0.01:
        raise ContractError(
            f"The scans of the pushes table have from {scales.min():.0f} to {scales.max():.0f} pixels a metre: "
            "resample them to one pixel size, or split the table."
        )
    height, width = (max(row.before.shape[axis] for row in rows) for axis in (0, 1))
    shape = (len(rows), height, width)
    before, after = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.float32)
    known = np.zeros(shape, dtype=np.bool_)
    window = np.stack([row.window_m for row in rows])
    for number, row in enumerate(rows):
        high, wide = row.before.shape
        known[number, :high, :wide] = np.isfinite(row.before) & np.isfinite(row.after)
        for into, part in ((before, row.before), (after, row.after)):
            into[number] = np.pad(
                fill_holes(part)[0].astype(np.float32), ((0, height - high), (0, width - wide)), mode="edge"
            )
        window[number, 1] -= (height - high) / row.pixels_per_m
        window[number, 2] += (width - wide) / row.pixels_per_m
    texts = {
        name: np.asarray(table.column(name).to_pylist(), dtype=np.str_)
        for name in ("session", "tool", "material", "kind")
    }
    return PushSamples(
        before=before,
        after=after,
        known=known,
        action=np.stack([row.action for row in rows]),
        window_m=window,
        pixels_per_m=scale,
        action_id=np.asarray(table.column("action_id").to_pylist(), dtype=np.int64),
        surface_m=np.array([row.surface_m for row in rows]),
        covariates=_covariates(table),
        **texts,
    )


def _covariates(table: pa.Table) -> dict[str, NDArray[np.float64]]:
    """Every numeric column, NaN where null; columns without any number are left out."""
    covariates = {}
    for field in table.schema:
        number = pa.types.is_integer(field.type) or pa.types.is_floating(field.type)
        if number and field.name not in _NOT_COVARIATES:
            values = np.array([math.nan if v is None else v for v in table.column(field.name).to_pylist()], np.float64)
            if np.isfinite(values).any():
                covariates[field.name] = values
    return covariates
