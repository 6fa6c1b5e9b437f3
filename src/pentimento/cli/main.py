"""The entry point of `pentimento`. A subcommand imports what it needs when it runs, so that the command starts fast."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from pentimento.cli import Command, diagnose, doctor, new, rate, record, recordings, robot
from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.output import escape_unknown_letters

COMMANDS = (
    diagnose.COMMAND, *robot.COMMANDS, record.COMMAND, *recordings.COMMANDS, rate.COMMAND, new.COMMAND, doctor.COMMAND,
)  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; return 0, or 1 with a sentence on stderr, or 130 after Ctrl-C."""
    escape_unknown_letters()
    parser = argparse.ArgumentParser(prog="pentimento", description="Robots that learn their own brushes.")
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        _add(subparsers, command)
    parsed = parser.parse_args(arguments)
    if (problem := parsed.command.problem(parsed)) is not None:
        parser.error(problem)
    try:
        parsed.command.run(parsed)
    except (PentimentoError, OSError, KeyboardInterrupt) as error:
        print("\n".join([f"pentimento: {_sentence(error)}", *getattr(error, "__notes__", [])]), file=sys.stderr)
        return 130 if isinstance(error, KeyboardInterrupt) else 1
    return 0


def _add(subparsers: Any, command: Command) -> None:
    parser = subparsers.add_parser(command.name, help=command.help, description=command.description)
    groups: dict[str | None, Any] = {None: parser}
    for option in command.options:
        if option.exclusive not in groups:
            groups[option.exclusive] = parser.add_mutually_exclusive_group()
        groups[option.exclusive].add_argument(*option.names, **option.settings)
    if command.subcommands:
        nested = parser.add_subparsers(required=True, metavar="|".join(each.name for each in command.subcommands))
        for each in command.subcommands:
            _add(nested, each)
    else:
        parser.set_defaults(command=command)


def _sentence(error: BaseException) -> str:
    """Describe an error; an error of the operating system by the file, where it names one, and the reason."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}." if error.filename is None else f"{error.filename}: {error.strerror}."
    return str(error) or "interrupted."


if __name__ == "__main__":
    sys.exit(main())
