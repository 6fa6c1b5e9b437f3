"""Rows of the strokes contract from recordings: a path, a photograph before and after it, and where these lie."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError, PentimentoError, UnitError
from pentimento.contracts.frames import check_window, crop, snap_window, window_around
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import arrow_schema, row_faults
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.units import parse_quantity

FloatArray = NDArray[np.float64]


class Placement(NamedTuple):
    """Where photographs lie on the canvas: by their edges or by their scale."""

    edges_m: tuple[float, float, float, float] | None
    """x_min, y_min, x_max, y_max in the frame of the paths, also where its y grows downwards."""
    pixels_per_m: float | None
    y_down: bool
    """Whether y of the paths grows downwards, from the photograph's top or within the edges."""

    @staticmethod
    def parsed(window: str | None, scale: str | None, y_down: bool) -> Placement:
        """Parse one of two texts with units: four edges, or pixels over length.

        Raises:
            ConfigError: the text is not such a quantity.
        """
        try:
            if scale is not None:
                pixels_per_m = parse_quantity(scale, "px/m")
                if not pixels_per_m > 0:
                    raise ConfigError(
                        f"--scale {scale} is not above zero; write pixels over length, such as '5 px/mm'."
                    )
                return Placement(None, pixels_per_m, y_down)
            edges = [parse_quantity(edge, "m") for edge in (window or "").split(",")]
            return Placement(check_window(edges), None, y_down)
        except (UnitError, ContractError) as error:
            raise ConfigError(
                f"{error} A window is written as left, lower, right, upper edge: '0 mm, 0 mm, 300 mm, 200 mm'."
                if scale is None
                else str(error)
            ) from error

    def window_m(self, shape: tuple[int, int]) -> tuple[float, float, float, float]:
        """Return x_min, y_min, x_max, y_max of a photograph of ``shape`` (H, W) in the canvas frame (y up).

        Where y grows downwards, the origin of the canvas frame is at the window's lower edge.
        """
        if self.pixels_per_m is not None:
            return 0.0, 0.0, shape[1] / self.pixels_per_m, shape[0] / self.pixels_per_m
        assert self.edges_m is not None
        x_min, y_min, x_max, y_max = self.edges_m
        return (x_min, 0.0, x_max, y_max - y_min) if self.y_down else self.edges_m

    def to_canvas(self, path: FloatArray, shape: tuple[int, int]) -> FloatArray:
        """Convert a path [N, 5] (t_s, x_m, y_m, z_m, yaw_rad) to the canvas frame: y up, yaw counter-clockwise."""
        if not self.y_down:
            return path
        lowest = self.edges_m[3] if self.edges_m is not None else self.window_m(shape)[3]
        turned = path.copy()
        turned[:, 2] = lowest - path[:, 2]
        turned[:, 4] = -path[:, 4]
        return turned


COMMAND: Final = "pentimento import"
MARGIN_M: Final = 0.012
"""Width of the paper around a stroke's path in its pictures."""


_MIN_POINTS: Final = 2


class RecordedPath(NamedTuple):
    """The path of one recorded stroke."""

    name: str
    path: FloatArray
    """[N, 5] t_s, x_m, y_m, z_m, yaw_rad in the frame of the recording."""
    about: dict[str, Any]
    """Values of other columns, numbers and texts, by the names of the contract."""
    fault: str | None
    """Why it cannot be used; None where it can."""


class Imported(NamedTuple):
    """Counts of an import."""

    rows: int
    refused: dict[str, list[str]]
    """Names of the strokes that were left out, by reason."""
    without_ink: int = 0
    """Number of rows whose photographs show no ink near the path."""


class Refused(PentimentoError):
    """One stroke cannot be used; the message is the reason."""


def stroke_row(
    stroke: RecordedPath,
    before: NDArray[np.uint8],
    after: NDArray[np.uint8],
    placement: Placement,
    given: Mapping[str, Any],
) -> dict[str, Any]:
    """Return a row whose pictures show the paper around the path.

    Args:
        stroke: its path is in the frame of ``placement``.
        before: photograph [H, W, 3], sRGB, rectified to ``placement``; likewise ``after``.
        given: values of columns for which the stroke has none.

    Raises:
        Refused: the photographs differ in size, the path has a fault or leaves them, or the row would break the
            contract.
    """
    if before.shape != after.shape:
        raise Refused("its two photographs differ in size")
    shape = before.shape[0], before.shape[1]
    path, whole = placed_path(stroke, placement, shape), np.array(placement.window_m(shape))
    try:
        window = snap_window(window_around(path, MARGIN_M), whole, shape)
        shown, shown_after = crop(before, whole, window), crop(after, whole, window)
    except ContractError as error:
        raise Refused(f"its window does not fit the photograph: {str(error).partition(';')[0].rstrip('.')}") from error
    return row_of(stroke, path, window, before=shown, after=shown_after, given=given)


def placed_path(stroke: RecordedPath, placement: Placement, shape: tuple[int, int]) -> FloatArray:
    """Return a stroke's path [N, 5] in the canvas frame, for photographs of ``shape`` (H, W).

    Raises:
        Refused: the path has a fault, or leaves the photograph.
    """
    if stroke.fault is not None:
        raise Refused(stroke.fault)
    path, whole = placement.to_canvas(stroke.path, shape), np.array(placement.window_m(shape))
    if not ((path[:, 1:3] >= whole[:2]) & (path[:, 1:3] <= whole[2:])).all():
        raise Refused("its path leaves the photograph")
    return path


def row_of(
    stroke: RecordedPath,
    path: FloatArray,
    window_m: FloatArray,
    *,
    before: NDArray[np.uint8],
    after: NDArray[np.uint8],
    given: Mapping[str, Any],
) -> dict[str, Any]:
    """Return a row of the pictures [h, w, 3] of a window [4]; path [N, 5] and window are in the canvas frame.

    If ``given`` names another ``frame``, they are in that one.

    Raises:
        Refused: the row would break the contract.
    """
    row = {**given, **stroke.about} | {
        "path": path.tolist(),
        "window_m": window_m.tolist(),
        "before": {"bytes": encode_png(before), "path": None},
        "after": {"bytes": encode_png(after), "path": None},
        "frame": given.get("frame", "canvas"),
    }  # fmt: skip
    fault = row_faults(table_of([row], list(stroke.about)), CONTRACT)[0]
    if fault is not None:
        raise Refused(fault)
    return row


def table_of(rows: list[dict[str, Any]], names: list[str]) -> pa.Table:
    """Return rows as a table: the contract's columns by its schema, others among ``names`` as float32 covariates."""
    present = {name for row in rows for name in row}
    schema = arrow_schema(CONTRACT, include_optional=present)
    for name in names:
        if CONTRACT.column(name) is None and name in present:
            schema = schema.append(pa.field(name, pa.float32()))
    return pa.Table.from_pylist(rows, schema=schema)


def card(source: str, tools: str, rows: int, refused: dict[str, list[str]]) -> str:
    """Return the first lines of a table's README.md."""
    left = f"{counted(refused)}." if refused else "none."
    return f"# Strokes of the {tools}\n\nImported from `{source}`: {rows} rows. Refused: {left}\n"


def counted(refused: dict[str, list[str]]) -> str:
    """Return how many were refused for each reason, as text."""
    return "; ".join(f"{len(names)} × {reason}" for reason, names in refused.items())


def path_fault(path: FloatArray) -> str | None:
    """Return why a path [N, 5] (t_s, x_m, y_m, z_m, yaw_rad) cannot be used, or None."""
    if len(path) < _MIN_POINTS:
        return f"it has fewer than {_MIN_POINTS} points"
    if not np.isfinite(path[:, 1:]).all() or np.isinf(path[:, 0]).any():
        return "a point is NaN or infinite"
    times = path[:, 0]
    if np.isnan(times).any():
        return None if np.isnan(times).all() else "it has times at some points only"
    return "its times run backwards" if (np.diff(times) < 0).any() else None
