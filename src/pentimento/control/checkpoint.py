"""What must not be lost when the computer goes down: one file of plain values and arrays, replaced whole each time."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ContractError

Arrays = dict[str, NDArray[Any]]
Kept = TypeVar("Kept")

_DAMAGE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, NotImplementedError, RuntimeError)
"""What reading a file raises that is cut short, overwritten, or none of ours."""


def keep(path: Path, schema: int, told: Mapping[str, Any], arrays: Arrays) -> None:
    """Replace the file. Raises OSError, and the old one is still there then."""
    told = {"schema": schema, **told}
    written = io.BytesIO()
    np.savez(written, allow_pickle=False, told=np.frombuffer(json.dumps(told).encode(), np.uint8), **arrays)
    atomic_write(path, written.getvalue())


def kept(path: Path, schema: int, work: str, made_of: Callable[[dict[str, Any], Arrays], Kept]) -> Kept:
    """What was kept last: ``made_of`` its plain values and arrays.

    Args:
        work: what it is the state of, such as a painting.

    Raises:
        ContractError: there is none, or it is damaged or of another version.
    """
    if not path.is_file():
        raise ContractError(f"{path.parent} holds no {path.name}: no {work} was begun there; begin one with --out.")
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as stored:
            arrays = dict(stored)
        told: dict[str, Any] = json.loads(arrays.pop("told").tobytes())
        if told["schema"] != schema:
            raise ContractError(f"{path} is of schema {told['schema']} and this is a runner of schema {schema}.")
        return made_of(told, arrays)
    except _DAMAGE as error:
        raise ContractError(f"{path} is damaged ({error!r}); begin the {work} anew.") from error
