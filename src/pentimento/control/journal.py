"""A journal of commands on disk: each is there, whole, before it is obeyed."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ContractError, PentimentoError

Obey = Callable[[str, list[Any]], Any]
"""Carry out a command by its name and plain arguments."""


class Journal:
    """Commands as lines of JSON, ``[name, [arguments]]``."""

    def __init__(self, path: Path, obey: Obey) -> None:
        """Obey the commands of the journal again, if there is one.

        Raises:
            ContractError: the journal is not one.
        """
        self._obey = obey
        path.parent.mkdir(parents=True, exist_ok=True)
        text = path.read_bytes() if path.exists() else b""
        whole = text[: text.rfind(b"\n") + 1]  # a line that was cut off was never obeyed
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                name, arguments = json.loads(line)
            except ValueError as error:
                raise ContractError(f"Line {number} of the journal {path} is damaged; start a new one.") from error
            with suppress(PentimentoError):  # what was refused then is refused again, and changes nothing
                obey(name, arguments)
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        os.ftruncate(self._file, len(whole))
        os.lseek(self._file, len(whole), os.SEEK_SET)

    def do(self, name: str, *arguments: Any) -> Any:
        """Write a command with its plain arguments, then obey it.

        Raises:
            OSError: it cannot be written, and was not obeyed.
        """
        line = (json.dumps([name, arguments]) + "\n").encode()
        start = os.lseek(self._file, 0, os.SEEK_CUR)
        try:
            if os.write(self._file, line) != len(line):
                raise OSError(f"The journal of the virtual robot takes no more than {start} bytes: the disk is full.")
        except OSError:
            os.ftruncate(self._file, start)
            os.lseek(self._file, start, os.SEEK_SET)
            raise
        return self._obey(name, list(arguments))

    def close(self) -> None:
        """No command is taken any more."""
        os.close(self._file)
