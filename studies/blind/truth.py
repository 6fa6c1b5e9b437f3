"""What a world hides, and the hash that commits to it before the verdict."""

from __future__ import annotations

import hashlib
import io
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import PentimentoError
from studies.blind.series import Stratum


class StrengthError(PentimentoError):
    """No strength gives an effect the wanted energy in this world."""


class TruthChanged(PentimentoError):
    """A truth does not have the hash that was published before the verdict."""


@dataclass(frozen=True)
class Strength:
    """A strength of an effect, and its energy q with standard error over the actions."""

    strength: float
    q: float
    q_se: float


@dataclass(frozen=True)
class Truth:
    """What a world hides. One strength for each cause, or one for the outside effect."""

    stratum: Stratum
    seed: int
    tool: str
    causes: tuple[str, ...]
    outside: Any
    """The kind's `Outside`, or None."""
    wanted_q: tuple[float, ...]
    strengths: tuple[Strength, ...]
    misshaped: bool


def write_world(folder: Path, table: pa.Table, truth: Truth) -> None:
    """Write `table.parquet`, `truth.json` and the truth's hash, `truth.sha256`."""
    write_parquet(folder / "table.parquet", table)
    text = (json.dumps(asdict(truth), indent=1) + "\n").encode()
    atomic_write(folder / "truth.sha256", (hashlib.sha256(text).hexdigest() + "\n").encode())
    atomic_write(folder / "truth.json", text)


def read_truth(path: Path, sha256: str) -> dict[str, Any]:
    """Read a truth after the verdict.

    Raises TruthChanged if its hash is another than `sha256`.
    """
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != sha256:
        raise TruthChanged(f"{path} changed after its hash was published; make and diagnose this world again.")
    truth: dict[str, Any] = json.loads(content)
    return truth


def write_parquet(path: Path, table: pa.Table) -> None:
    """Write a table atomically."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    atomic_write(path, buffer.getvalue())
