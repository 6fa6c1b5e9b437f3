"""What a table's columns mean: name, Arrow type, unit, frame, one sentence; and what makes a row bad.

Images are stored as Hugging Face's `Image` feature stores them (bytes and an optional path), paths as
a list of float32[5], vectors as fixed-size lists.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

import pyarrow as pa

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
    """A table: its columns in order. Other numeric columns may stand beside them (covariates)."""

    name: str
    columns: tuple[Column, ...]
    description: str

    def column(self, name: str) -> Column | None:
        """The column of that name, or None where the contract does not speak of it."""
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
