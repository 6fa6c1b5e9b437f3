"""Reading of the files that other stages wrote, with errors that name the stage to run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ContractError


def read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ContractError(
            f"{path} cannot be read ({error.strerror}); run `make repro`, which makes what is missing."
        ) from error


def read_json(path: Path) -> Any:
    try:
        return json.loads(read_bytes(path))
    except ValueError as error:
        raise ContractError(f"{path} is not JSON ({error}); remove its folder and run `make repro`.") from error


def incomplete(folder: Path, error: Exception, stage: str) -> ContractError:
    return ContractError(f"The results in {folder} lack an entry ({error}); run the stage {stage} again.")
