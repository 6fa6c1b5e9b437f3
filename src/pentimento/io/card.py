"""`pentimento card`: the data card of a table, with warnings and the causes that it cannot show."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.contracts import pushes, strokes
from pentimento.contracts.atomic import add_to_record, atomic_write
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.schema import TableContract
from pentimento.contracts.tables import CheckedTable, parquet_files, read_table
from pentimento.diagnosis.experiment_design import aliasing_sentences
from pentimento.diagnosis.pushes.measured import measure
from pentimento.diagnosis.pushes.problem import observable_causes as observable_of_pushes
from pentimento.diagnosis.strokes.aliasing import aliasing_of
from pentimento.diagnosis.strokes.fit import first_model
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import observable_causes
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.strokes.mechanisms import VOCABULARY as OF_STROKES
from pentimento.io.table_checks import (
    commanded_pushes,
    commanded_strokes,
    confounded_with_time,
    drift,
    heading_of_pushes,
    heading_of_strokes,
    imbalance,
    in_order,
    shown_pushes,
    shown_strokes,
    too_little,
)
from pentimento.planning.pushes.analytic.mechanisms import VOCABULARY as OF_PUSHES

Array = NDArray[np.float64]

NAME = "CARD.md"
_TITLE = b"# Card of `"


class _Content(NamedTuple):
    """What the card of strokes or of pushes reports."""

    commanded: dict[str, Array]
    shown: dict[str, Array]
    heading: Array
    unseen: dict[str, str]
    """Causes that the table cannot show, and why."""
    aliasing: list[str]
    """Sentences about causes that its design cannot distinguish."""


def write_card(rows: Path, out: Path | None) -> tuple[Path, list[str]]:
    """Write the data card of a table as Markdown; return its path and its warnings.

    Args:
        rows: a Parquet file in the strokes or the pushes contract, or a folder of shards.
        out: the file; by default ``CARD.md`` in the folder, or ``<name>.card.md`` next to the file.

    Raises:
        ContractError: the rows cannot be read, or there are none.
        ConfigError: there is a file that is no card.
    """
    place = out or (rows / NAME if rows.is_dir() else rows.with_suffix(".card.md"))
    if place.exists() and not (place.is_file() and place.read_bytes().startswith(_TITLE)):
        raise ConfigError(f"{place} is no data card, and would be replaced; name another file by --out.")
    contract = pushes.CONTRACT if "action" in _columns(rows) else strokes.CONTRACT
    checked = read_table(rows, contract)
    if checked.table.num_rows == 0:
        raise ContractError(f"{rows} holds no rows to describe.")
    content = _of_pushes(checked.table) if contract is pushes.CONTRACT else _of_strokes(checked.table)
    warnings = _warnings(checked, content)
    atomic_write(place, _markdown(rows.name, contract, checked, content, warnings).encode())
    if place == rows / NAME:
        add_to_record(rows, NAME)
    return place, warnings


def _columns(rows: Path) -> list[str]:
    """Return the columns of the first shard; none for an unreadable one, whose reader reports the error."""
    files = parquet_files(rows)
    try:
        return list(pq.read_schema(files[0]).names) if files else []
    except (OSError, pa.ArrowException):
        return []


def _of_strokes(table: pa.Table) -> _Content:
    measured = load_measured(table)
    aliasing = aliasing_sentences(aliasing_of(first_model(measured), measured, OF_STROKES))
    return _Content(
        commanded_strokes(table), shown_strokes(table), heading_of_strokes(table), _not_shown(measured), aliasing
    )


def _not_shown(measured: Measured) -> dict[str, str]:
    by_measured_path = measured.following is not None
    return observable_causes(OF_STROKES, measured.context, path_measured=by_measured_path)[1]


def _of_pushes(table: pa.Table) -> _Content:
    samples, _ = load_pushes(table)
    alone = samples.pick(samples.kind == "push")  # the causes are of pushes
    if len(alone.kind):
        _, unseen = observable_of_pushes(measure(alone), OF_PUSHES)
    else:
        unseen = {kind.cause: "all rows are pinches, and causes are known of pushes alone" for kind in OF_PUSHES}
    return _Content(commanded_pushes(table), shown_pushes(table), heading_of_pushes(table), unseen, [])


def _warnings(checked: CheckedTable, content: _Content) -> list[str]:
    table, sessions = checked.table, in_order(checked.table)
    warnings = [f"Row {bad.row} breaks the contract and is left out: {bad.reason}." for bad in checked.quarantined]
    warnings += too_little(table)
    warnings += drift(content.shown, sessions)
    warnings += confounded_with_time(content.commanded, sessions)
    warnings += imbalance(table, content.heading, content.commanded)
    return warnings + [f"Aliasing: {line}" for line in content.aliasing]


def _markdown(name: str, contract: TableContract, checked: CheckedTable, content: _Content, warnings: list[str]) -> str:
    table = checked.table
    actions, sessions = set(table["action_id"].to_pylist()), set(table["session"].to_pylist())
    tools = sorted(set(table["tool"].to_pylist()))
    lines = [
        f"# Card of `{name}`",
        "",
        f"{table.num_rows} {contract.name} of {', '.join(tools)}: {len(actions)} actions in {len(sessions)} "
        f"session{'s' if len(sessions) > 1 else ''}; {len(checked.quarantined)} rows quarantined.",
        "",
        "## Warnings",
        "",
        *([f"- {warning}" for warning in warnings] or ["None."]),
        "",
        "## Commands and observations",
        "",
        "| | 5 % | median | 95 % | unknown |",
        "|---|---|---|---|---|",
        *(_quantiles(quantity, values) for quantity, values in (content.commanded | content.shown).items()),
        "",
        "## What it cannot show",
        "",
        *([f"- `{cause}`: {reason}." for cause, reason in content.unseen.items()] or ["Every cause can be tested."]),
        "",
        "## Columns",
        "",
        f"Not recorded: {_listed(c.name for c in contract.columns if not _known(table, c.name))}.",
        "",
        f"Further covariates: {_listed(n for n in table.column_names if contract.column(n) is None)}.",
        "",
    ]
    return "\n".join(lines)


def _quantiles(name: str, values: Array) -> str:
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return f"| {name} | | | | {len(values)} |"
    low, middle, high = np.quantile(known, [0.05, 0.5, 0.95])
    return f"| {name} | {low:.3g} | {middle:.3g} | {high:.3g} | {len(values) - len(known)} |"


def _known(table: pa.Table, name: str) -> bool:
    """Whether some row has a value in the column."""
    if name not in table.column_names:
        return False
    return any(_is_known(value) for value in table[name].to_pylist())


def _is_known(value: object) -> bool:
    if isinstance(value, list):
        return bool(value) and any(_is_known(inner) for inner in value)
    return value is not None and value == value  # NaN differs from itself


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "none"
