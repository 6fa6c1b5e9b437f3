"""Table contracts: each column's name, Arrow type, unit, frame and description, and the checks of a row.

Images are stored as Hugging Face's `Image` feature stores them (bytes and an optional path), paths as
a list of float32[5], vectors as fixed-size lists.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pentimento.contracts.errors import ContractError, ImageError
from pentimento.contracts.frames import check_window, pixels_per_m
from pentimento.contracts.images import decode_png

IMAGE: Final[pa.DataType] = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
PATH: Final[pa.DataType] = pa.list_(pa.list_(pa.float32(), 5))


def vector(length: int) -> pa.DataType:
    """float32[length]."""
    return pa.list_(pa.float32(), length)


@dataclass(frozen=True)
class Column:
    """One column. `unit` and `frame` are "" where they make no sense."""

    name: str
    type: pa.DataType
    unit: str
    frame: str
    description: str
    required: bool
    may_be_nan: tuple[int, ...] = ()
    """Components of a vector or of a path's points in which NaN means unknown."""
    choices: tuple[str, ...] = ()
    """For text: the only values; () = any."""


@dataclass(frozen=True)
class TableContract:
    """A table: its columns in order. Other numeric columns are allowed (covariates)."""

    name: str
    columns: tuple[Column, ...]
    description: str

    def column(self, name: str) -> Column | None:
        """The column of that name, or None where the contract has none."""
        return next((column for column in self.columns if column.name == name), None)


def needed(name: str, kind: pa.DataType, description: str, unit: str = "", frame: str = "", **more: Any) -> Column:
    """A required column; `more` are `may_be_nan` and `choices`."""
    return Column(name, kind, unit, frame, description, required=True, **more)


def known(name: str, kind: pa.DataType, description: str, unit: str = "", frame: str = "", **more: Any) -> Column:
    """An optional column, in which null or NaN means unknown; `more` are `may_be_nan` and `choices`."""
    return Column(name, kind, unit, frame, description, required=False, **more)


def arrow_schema(contract: TableContract, include_optional: bool | Collection[str] = True) -> pa.Schema:
    """The Arrow schema of a contract; unit, frame and description stand in each field's metadata.

    Args:
        include_optional: all optional columns, none, or only those named.
    """
    return pa.schema([arrow_field(c) for c in contract.columns if c.required or _named(c.name, include_optional)])


def arrow_field(column: Column) -> pa.Field:
    """A column as an Arrow field."""
    about = {"unit": column.unit, "frame": column.frame, "description": column.description}
    return pa.field(column.name, column.type, metadata={k: v for k, v in about.items() if v})


def _named(name: str, include: bool | Collection[str]) -> bool:
    return include if isinstance(include, bool) else name in include


def columns_markdown(contract: TableContract) -> str:
    """The columns as a Markdown table, for README cards."""
    rows = [("column", "type", "unit", "frame", "required", "meaning"), ("---",) * 6]
    for c in contract.columns:
        needed = "yes" if c.required else ""
        rows.append((f"`{c.name}`", type_name(c.type), c.unit, c.frame, needed, c.description))
    return f"{contract.description}\n\n" + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def type_name(kind: pa.DataType) -> str:
    """A short readable name of an Arrow type: `float32[4]`, `list of float32[5]`, `image`."""
    if kind == IMAGE:
        return "image"
    if pa.types.is_fixed_size_list(kind):
        return f"{type_name(kind.value_type)}[{kind.list_size}]"
    if pa.types.is_list(kind) or pa.types.is_large_list(kind):
        return f"list of {type_name(kind.value_type)}"
    return {"float": "float32", "double": "float64"}.get(str(kind), str(kind))


def row_faults(table: pa.Table, contract: TableContract) -> list[str | None]:
    """For each row of a table of the contract's types: the reason why it is bad, or None.

    Bad are: null, NaN or infinity in a required column (except where NaN means unknown), an infinity or
    a partly unknown vector in an optional one, an empty path, a path whose times run backwards, text that
    is none of the choices, an unreadable image, an empty window, images of a row that differ in
    size, and an image whose pixels are not square in its window.
    """
    present = [column for column in contract.columns if column.name in table.column_names]
    chunks = (_batch_faults(batch, present) for batch in table.to_batches(max_chunksize=256))
    return [fault for chunk in chunks for fault in chunk]


def _batch_faults(batch: pa.RecordBatch, columns: list[Column]) -> list[str | None]:
    values = {column.name: batch.column(column.name).to_pylist() for column in columns}
    return [
        _row_fault({name: column[row] for name, column in values.items()}, columns) for row in range(batch.num_rows)
    ]


def _row_fault(row: dict[str, Any], columns: list[Column]) -> str | None:
    for column in columns:
        fault = _value_fault(row[column.name], column)
        if fault is not None:
            return f"{column.name} {fault}"
    return _images_fault(row, columns)


def _value_fault(value: Any, column: Column) -> str | None:
    if value is None:
        return "is null" if column.required else None
    if column.choices:
        return None if value in column.choices else f"is none of {', '.join(column.choices)}"
    if column.type == IMAGE:
        return "has no image bytes" if value["bytes"] is None and column.required else None
    if column.type == PATH:
        if any(point is None for point in value):
            return "has a null point"
        return _path_fault(np.asarray(value, dtype=np.float64), column)
    if column.name == "window_m":
        return _window_fault(value)
    if _numeric(column.type):
        return _number_fault(np.atleast_1d(np.array(value, dtype=np.float64)), column)
    return None


def _numeric(kind: pa.DataType) -> bool:
    inner = kind.value_type if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) else kind
    return bool(pa.types.is_integer(inner) or pa.types.is_floating(inner))


def _number_fault(numbers: npt.NDArray[np.float64], column: Column) -> str | None:
    if np.isinf(numbers).any():
        return "is infinite"
    must = np.delete(numbers, column.may_be_nan)
    if column.required and np.isnan(must).any():
        return "is NaN"
    return None


def _path_fault(path: npt.NDArray[np.float64], column: Column) -> str | None:
    if path.size == 0:
        return "is empty"
    if path.ndim != 2 or np.isinf(path).any() or np.isnan(np.delete(path, column.may_be_nan, axis=1)).any():
        return "has a NaN or infinite number"
    times_s = path[:, 0]
    if np.isnan(times_s).any():
        return None if np.isnan(times_s).all() else "has times at some points only"
    return "has times that run backwards" if (np.diff(times_s) < 0).any() else None


def _window_fault(window: Any) -> str | None:
    try:
        check_window([np.nan if v is None else v for v in window])
    except ContractError:
        return "is not x_min < x_max and y_min < y_max in finite metres"
    return None


def _images_fault(row: dict[str, Any], columns: list[Column]) -> str | None:
    shapes: dict[str, tuple[int, ...]] = {}
    for column in columns:
        value = row[column.name]
        if column.type != IMAGE or value is None or value["bytes"] is None:
            continue
        try:
            shapes[column.name] = decode_png(value["bytes"]).shape[:2]
        except ImageError:
            return f"{column.name} is not a readable PNG"
    if len(set(shapes.values())) > 1:
        return f"{', '.join(shapes)} differ in size"
    if row.get("window_m") is not None and shapes:
        try:
            pixels_per_m(next(iter(shapes.values())), row["window_m"])
        except ContractError:
            return "images have pixels that are not square in window_m"
    return None
