"""Least-squares fit of the place model to rows of the ``pushes`` contract of the kind ``place``."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pentimento.contracts.errors import ContractError
from pentimento.contracts.frames import pixel_to_canvas, pixels_per_m
from pentimento.contracts.height_maps import decode_height_m
from pentimento.contracts.pushes import PLACE
from pentimento.planning.pushes.places import FLATNESS, GROWTH, PlaceModel
from pentimento.robots.tools import ball_diameter_m

FloatArray = NDArray[np.float64]

MIN_PLACES = 6
"""Fewer pellets leave four numbers and their spread too uncertain."""
_AROUND_M = 0.025
"""Distance around a pellet within which it is fitted: twice the largest footprint of the shipped feeder."""


def rows_of_places(table: pa.Table) -> pa.Table:
    """The rows of a ``pushes`` table whose kind is ``place``."""
    return table.filter(pc.equal(table["kind"], PLACE))


def fit_places(table: pa.Table) -> PlaceModel:
    """The place model of a table's pellets; rows of other kinds are ignored.

    Raises:
        ContractError: fewer than ``MIN_PLACES`` pellets, several feeders, an unknown volume, volumes that hardly
            differ, or heights that show no pellet.
    """
    rows = rows_of_places(table)
    if rows.num_rows < MIN_PLACES:
        raise ContractError(
            f"The table holds {rows.num_rows} placed pellets and a place model needs {MIN_PLACES}; collect more "
            "(params.yaml: collect_pushes.pellets)."
        )
    feeders = sorted(set(rows["tool"].to_pylist()))
    if len(feeders) > 1:
        raise ContractError(f"The pellets come from several feeders ({', '.join(feeders)}); split the table.")
    distances, changes, volumes = zip(*(_around(row) for row in rows.to_pylist()), strict=True)
    low, high = min(volumes), max(volumes)
    if high < 1.5 * low:
        raise ContractError(
            f"The pellets' volumes, {low:.3g} to {high:.3g} m³, hardly differ, so that the growth of their footprint "
            "is unknown; vary the diameter."
        )
    each = np.repeat(volumes, [len(values) for values in distances])
    distance, change = np.concatenate(distances), np.concatenate(changes)
    reference = float(np.exp(np.mean(np.log(volumes))))
    gained = float(change.sum())
    if gained <= 0:
        raise ContractError("The scans show no added material around the pellets; check before and after, and x, y.")

    def model_of(unknowns: FloatArray) -> PlaceModel:
        kept, width = np.exp(unknowns[:2])
        return PlaceModel(
            feeders[0], float(kept), float(width), float(unknowns[2]), float(unknowns[3]), reference, (low, high), 0.0,
            rows.num_rows,
        )  # fmt: skip

    def residual(unknowns: FloatArray) -> FloatArray:
        return 1e3 * (_profile(model_of(unknowns), distance, each) - change)

    start = np.array([np.log(0.8), np.log(0.6 * ball_diameter_m(reference)), 1 / 3, 3.0])
    bounds = ([-4.0, -7.6, GROWTH[0], FLATNESS[0]], [1.0, -3.0, GROWTH[1], FLATNESS[1]])  # widths of 0.5 to 50 mm
    found = least_squares(residual, start, bounds=bounds, x_scale=[0.1, 0.1, 0.1, 1.0])
    left = float(np.square(found.fun).sum() / np.square(1e3 * change).sum())
    fitted = model_of(found.x)
    return PlaceModel(
        fitted.feeder, fitted.kept, fitted.width_m, fitted.growth, fitted.flatness, reference, (low, high), left,
        rows.num_rows,
    )  # fmt: skip


def _profile(model: PlaceModel, distance_m: FloatArray, volume_m3: FloatArray) -> FloatArray:
    """f [P] at distances [P] from pellets of volumes [P]."""
    radius = model.width_m * (volume_m3 / model.reference_m3) ** model.growth
    peak = model.peak_m(model.reference_m3) * (volume_m3 / model.reference_m3) ** (1 - 2 * model.growth)
    return np.asarray(peak * np.exp(-((distance_m / radius) ** model.flatness)))


def _around(row: dict[str, object]) -> tuple[FloatArray, FloatArray, float]:
    """Distances [P] from a pellet, changes of height [P] there, where both scans have seen them, and its volume."""
    volume = row.get("volume_m3")
    if not isinstance(volume, float) or not volume > 0:
        raise ContractError(f"The pellet of order {row['order']} has the volume {volume}; it must be above 0 m³.")
    before, after = (
        decode_height_m(row[name]["bytes"], float(row["height_per_unit_m"]))  # type: ignore[index,arg-type]
        for name in ("before", "after")
    )
    window = np.asarray(row["window_m"], dtype=np.float64)
    pixels = np.stack(np.meshgrid(np.arange(before.shape[1]), np.arange(before.shape[0])), axis=-1)
    places = pixel_to_canvas(pixels, window, pixels_per_m(before.shape, window))
    x_m, y_m = np.asarray(row["action"], dtype=np.float64)[:2]
    distance = np.hypot(places[..., 0] - x_m, places[..., 1] - y_m)
    known = (distance < _AROUND_M) & np.isfinite(before) & np.isfinite(after)
    return distance[known], (after - before)[known], volume
