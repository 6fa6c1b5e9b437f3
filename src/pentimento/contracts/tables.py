"""Reading and writing contract tables: Parquet shards with a README data card.

A reader checks the schema, then each row. Rows that break the contract are quarantined: left out, and returned with the
reason. One bad row is always accepted. More than one and more than 1 % of the rows is an error, because then the
recording is wrong. A writer accepts none.
"""

import hashlib
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pentimento.contracts.atomic import atomic_folder, command_folder
from pentimento.contracts.errors import ContractError
from pentimento.contracts.schema import TableContract, arrow_field, columns_markdown, row_faults, type_name

SHARD_BYTES: Final = 256 * 2**20
_MAX_LISTED = 8
"""Row numbers that a message lists."""
MAX_BAD_SHARE: Final = 0.01


@dataclass(frozen=True)
class Quarantined:
    """A row that was left out: its index in the file or folder as stored, and why."""

    row: int
    reason: str


@dataclass(frozen=True, eq=False)
class CheckedTable:
    """Rows that keep the contract, and those that do not."""

    table: pa.Table
    quarantined: tuple[Quarantined, ...]


def write_table(
    folder: Path, table: pa.Table, contract: TableContract, card: str, *, command: str | None = None
) -> None:
    """Write a table as a folder of shards with README.md (`card` and the columns' meaning), atomically.

    Args:
        command: of a user, which then may replace nothing but a folder of its own (`command_folder`).

    Raises:
        ContractError: the schema or any row breaks the contract; nothing is written.
        ConfigError: the folder holds what ``command`` did not write.
    """
    checked = _valid(table, contract)
    replacing = atomic_folder(Path(folder)) if command is None else command_folder(Path(folder), command)
    with replacing as temporary:
        _write_checked(temporary, checked)
        (temporary / "README.md").write_text(
            f"{card.rstrip()}\n\n## Columns\n\n{columns_markdown(contract)}", encoding="utf-8"
        )


def write_shards(folder: Path, table: pa.Table, contract: TableContract) -> None:
    """Write only the shards, into an existing folder (one that `atomic_folder` gave).

    Raises:
        ContractError: the schema or any row breaks the contract; nothing is written.
    """
    _write_checked(Path(folder), _valid(table, contract))


def read_table(path: Path, contract: TableContract) -> CheckedTable:
    """Read one Parquet file, or all visible `*.parquet` in a folder by name, and check them against a contract.

    Integer and float widths are cast; other columns (covariates) are kept as they are, except those that only number
    the rows (`is_index`).

    Raises:
        ContractError: nothing to read, a required column missing, a column of a wrong type, or too many
            bad rows (with counts per reason).
    """
    path = Path(path)
    files = parquet_files(path)
    if not files:
        raise ContractError(f"Folder {path} holds no *.parquet file; make the table of {contract.name} first.")
    parts = [_cast(_without_index(_read_parquet(file), contract), contract, str(file)) for file in files]
    try:
        table = pa.concat_tables(parts, promote_options="permissive")
    except pa.ArrowException as error:
        raise ContractError(f"The shards in {path} do not fit together: {error}.") from error
    checked = _without_faults(table, contract)
    _check_share(checked.quarantined, table.num_rows, contract, str(path))
    return checked


def stream_table(path: Path, contract: TableContract, rows: int) -> Iterator[CheckedTable]:
    """`read_table` in parts of at most this many rows, in order, of which the caller holds one at a time.

    Raises:
        ContractError: as `read_table`; that too many rows are bad is known after the last part.
    """
    path = Path(path)
    files = parquet_files(path)
    if not files:
        raise ContractError(f"Folder {path} holds no *.parquet file; make the table of {contract.name} first.")
    quarantined: list[Quarantined] = []
    before = 0
    for file in files:
        for table in _read_parts(file, rows):
            part = _cast(_without_index(table, contract), contract, str(file))
            checked = _without_faults(part, contract)
            bad = tuple(Quarantined(before + each.row, each.reason) for each in checked.quarantined)
            yield CheckedTable(checked.table, bad)
            quarantined += bad
            before += part.num_rows
    _check_share(quarantined, before, contract, str(path))


def parquet_files(path: Path) -> list[Path]:
    """A Parquet file, or those in a folder by name, without hidden ones (`._part.parquet`, which macOS writes)."""
    return sorted(visible(path.glob("*.parquet"))) if path.is_dir() else [path]


def visible(files: Iterable[Path]) -> Iterator[Path]:
    """The files whose names do not begin with a dot."""
    return (file for file in files if not file.name.startswith("."))


_UNNAMED: Final = re.compile(r"|unnamed: \d+|__index_level_\d+__")
_INDEX_NAMES: Final = ("index", "level_0", "row", "row_id", "rowid", "row_nr", "id")


def is_index(name: str, values: Sequence[Any]) -> bool:
    """Whether a column only numbers the rows, as data frames write it beside the data: it is no covariate.

    Its values are whole numbers, and its name is empty or one that pandas makes up. Under a name such as `index` or
    `id` they must differ, too.
    """
    lower = name.strip().lower()
    unnamed = _UNNAMED.fullmatch(lower) is not None
    if not unnamed and lower not in _INDEX_NAMES:
        return False
    try:
        numbers = [float(value) for value in values]
    except (TypeError, ValueError):
        return False
    return all(number.is_integer() for number in numbers) and (unnamed or len(set(numbers)) == len(numbers))


def _without_faults(table: pa.Table, contract: TableContract) -> CheckedTable:
    quarantined = tuple(
        Quarantined(row, reason) for row, reason in enumerate(row_faults(table, contract)) if reason is not None
    )
    if not quarantined:
        return CheckedTable(table, ())
    bad = {q.row for q in quarantined}
    return CheckedTable(
        table.filter(pa.array([row not in bad for row in range(table.num_rows)], pa.bool_())), quarantined
    )


def _check_share(quarantined: Sequence[Quarantined], rows: int, contract: TableContract, where: str) -> None:
    """Raise `ContractError` for too many bad rows."""
    count = len(quarantined)
    if count > max(1, math.floor(MAX_BAD_SHARE * rows)) or 0 < count == rows:
        raise ContractError(
            f"{count} of {rows} rows of {where} break the {contract.name} contract: "
            f"{_counted(q.reason for q in quarantined)}. Repair the recording; at most 1 % is quarantined."
        )


def _counted(reasons: Iterable[str]) -> str:
    return "; ".join(f"{count} x {reason}" for reason, count in Counter(reasons).most_common())


def _valid(table: pa.Table, contract: TableContract) -> pa.Table:
    table = _cast(table, contract, "The table to write")
    reasons = [reason for reason in row_faults(table, contract) if reason is not None]
    if reasons:
        raise ContractError(
            f"{len(reasons)} of {table.num_rows} rows to write break the {contract.name} contract: {_counted(reasons)}."
        )
    return table


def _write_checked(folder: Path, table: pa.Table) -> None:
    """part-00000.parquet, ...: shards of equal row counts, each of about `SHARD_BYTES` at most."""
    shards = max(1, math.ceil(table.nbytes / SHARD_BYTES))
    rows = max(1, math.ceil(table.num_rows / shards))
    for part, start in enumerate(range(0, max(table.num_rows, 1), rows)):
        pq.write_table(table.slice(start, rows), folder / f"part-{part:05d}.parquet", compression="zstd")


def _read_parquet(file: Path) -> pa.Table:
    try:
        with pq.ParquetFile(file) as opened:
            return opened.read()
    except (OSError, pa.ArrowException) as error:
        raise ContractError(f"{file} cannot be read as Parquet: {error}. Check the path or copy it again.") from error


def _read_parts(file: Path, rows: int) -> Iterator[pa.Table]:
    try:
        with pq.ParquetFile(file) as opened:
            if not opened.metadata.num_rows:
                yield opened.schema_arrow.empty_table()
            for batch in opened.iter_batches(rows):
                yield pa.Table.from_batches([batch])
    except (OSError, pa.ArrowException) as error:
        raise ContractError(f"{file} cannot be read as Parquet: {error}. Check the path or copy it again.") from error


def _without_index(table: pa.Table, contract: TableContract) -> pa.Table:
    others = [name for name in table.column_names if contract.column(name) is None]
    numbers = [name for name in others if _numeric(table.schema.field(name).type)]
    return table.drop_columns([name for name in numbers if is_index(name, table.column(name).to_pylist())])


def _numeric(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


def _cast(table: pa.Table, contract: TableContract, where: str) -> pa.Table:
    """The table with the contract's columns in the contract's types and order, then the others."""
    if len(set(table.column_names)) < table.num_columns:
        raise ContractError(f"{where} has two columns of one name among {table.column_names}.")
    fields: list[pa.Field] = []
    arrays: list[pa.ChunkedArray] = []
    for column in contract.columns:
        if column.name not in table.column_names:
            if column.required:
                raise ContractError(
                    f"{where} lacks the required column {column.name!r} ({type_name(column.type)}: "
                    f"{column.description}) of the {contract.name} contract."
                )
            continue
        values = table.column(column.name)
        complaint = (
            f"{where}: column {column.name!r} is {type_name(values.type)}, but the {contract.name} contract "
            f"needs {type_name(column.type)} ({column.description})."
        )
        if not _fits(values.type, column.type):
            raise ContractError(complaint)
        try:
            arrays.append(_without_null_vectors(_cast_values(values, column.type)))
        except pa.ArrowInvalid as error:
            raise ContractError(f"{complaint} Its values do not convert: {error}.") from error
        fields.append(arrow_field(column))
    for name in table.column_names:
        if contract.column(name) is None:
            fields.append(table.schema.field(name))
            arrays.append(_without_null_vectors(table.column(name)))
    return pa.table(arrays, schema=pa.schema(fields))


def _cast_values(values: pa.ChunkedArray, kind: pa.DataType) -> pa.ChunkedArray:
    if values.type == kind:
        return values
    if pa.types.is_floating(values.type) and pa.types.is_integer(kind):
        # Data frames turn an integer column with gaps into floats with NaN.
        values = pc.if_else(pc.is_nan(values), pa.scalar(None, values.type), values)
    return values.cast(kind)


def _without_null_vectors(values: pa.ChunkedArray) -> pa.ChunkedArray:
    """Null vectors of fixed length become NaN (0 for integers): pyarrow writes null ones to Parquet but
    cannot read them back."""
    if not pa.types.is_fixed_size_list(values.type) or values.null_count == 0:
        return values
    unknown = float("nan") if pa.types.is_floating(values.type.value_type) else 0
    fill = [unknown] * values.type.list_size
    return pa.chunked_array(
        [pa.array([fill if v is None else v for v in chunk.to_pylist()], values.type) for chunk in values.chunks],
        type=values.type,
    )


def _fits(actual: pa.DataType, wanted: pa.DataType) -> bool:
    """Whether two types differ only in width or in how Arrow lays them out."""
    t = pa.types
    if actual == wanted or t.is_null(actual):
        return True
    if t.is_dictionary(actual):
        return _fits(actual.value_type, wanted)
    if t.is_string(wanted):
        return bool(t.is_large_string(actual) or t.is_string_view(actual))
    if t.is_binary(wanted):
        return bool(t.is_large_binary(actual) or t.is_binary_view(actual))
    if t.is_integer(wanted) or t.is_floating(wanted):
        return bool(t.is_integer(actual) or t.is_floating(actual))
    if t.is_struct(wanted):
        return _fits_struct(actual, wanted)
    if t.is_list(wanted) or t.is_fixed_size_list(wanted):
        sizes_agree = not (t.is_fixed_size_list(wanted) and t.is_fixed_size_list(actual)) or (
            actual.list_size == wanted.list_size
        )
        is_list = t.is_list(actual) or t.is_large_list(actual) or t.is_fixed_size_list(actual)
        return bool(is_list) and sizes_agree and _fits(actual.value_type, wanted.value_type)
    return False


def _fits_struct(actual: pa.DataType, wanted: pa.DataType) -> bool:
    if not pa.types.is_struct(actual):
        return False
    types: dict[str, Any] = {actual.field(i).name: actual.field(i).type for i in range(actual.num_fields)}
    fields = [wanted.field(i) for i in range(wanted.num_fields)]
    return len(types) == len(fields) and all(f.name in types and _fits(types[f.name], f.type) for f in fields)


def row_list(numbers: Sequence[int]) -> str:
    """Row numbers for a message, such as "Rows 1, 4 (counted from 0)"."""
    listed = ", ".join(str(number) for number in numbers[:_MAX_LISTED])
    more = f" and {len(numbers) - _MAX_LISTED} more" if len(numbers) > _MAX_LISTED else ""
    return f"{'Row' if len(numbers) == 1 else 'Rows'} {listed}{more} (counted from 0)"


def reason_list(bad: Mapping[int, str]) -> str:
    """The three most frequent reasons of bad rows, by row number, for a message."""
    return "; ".join(
        f"{count} × {reason.rstrip('.')}" if count > 1 else reason.rstrip(".")
        for reason, count in Counter(bad.values()).most_common(3)
    )


def row_fingerprint(row: Mapping[str, Any], command: str) -> bytes:
    """Digest of a row's session, command (the column ``command``), window and both images: equal for copies."""
    digest = hashlib.sha256(repr([row["session"], row[command], row["window_m"]]).encode())
    digest.update(row["before"]["bytes"])
    digest.update(row["after"]["bytes"])
    return digest.digest()
