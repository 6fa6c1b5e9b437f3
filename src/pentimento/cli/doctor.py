"""`pentimento doctor`: what this computer has, what is wrong, and the command that mends it."""

from __future__ import annotations

import argparse
from pathlib import Path

from pentimento.cli import Command
from pentimento.contracts.errors import ConfigError


def _doctor(_: argparse.Namespace) -> None:
    """Print a line for each part.

    Raises:
        ConfigError: something is wrong that stops `make repro`.
    """
    from pentimento.cli.doctor_computer import computer
    from pentimento.cli.doctor_pipeline import is_clone, pipeline

    root = Path.cwd()
    findings = [*computer(root), *pipeline(root)]
    width = max(len(found.part) for found in findings)
    for found in findings:
        mend = f" Mend it with: {found.mend}" if found.mend else ""
        print(f"{found.state:5}  {found.part:{width}}  {found.text}{mend}")
    if wrong := [found.part for found in findings if found.state == "wrong"]:
        raise ConfigError(f"{', '.join(wrong)}: mend this before `make repro`.")
    if not is_clone(root):
        print(
            "This folder is no clone of the project: bundles run here; `make repro` and `pip install .` need a clone."
        )


COMMAND = Command(
    "doctor",
    "what this computer has, what is wrong, and the command that mends it",
    run=_doctor,
    description="Print a line for each part. ok: nothing is to be done. note: something is missing, and only what the "
    "line names needs it. wrong: `make repro` cannot run before this is mended; the exit status is then 1.",
)
