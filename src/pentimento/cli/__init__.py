"""The command `pentimento`: how a subcommand is declared, the types of its arguments, and what it needs installed."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.units import parse_quantity


class Option(NamedTuple):
    """One argument of a subcommand."""

    names: tuple[str, ...]
    exclusive: str | None
    """Options of the same group exclude each other."""
    settings: dict[str, Any]
    """Of `argparse`'s `add_argument`."""


def option(*names: str, exclusive: str | None = None, **settings: Any) -> Option:
    """Declare an argument as `argparse`'s `add_argument` does."""
    return Option(names, exclusive, settings)


def _no_problem(_: argparse.Namespace) -> str | None:
    return None


@dataclass(frozen=True)
class Command:
    """One subcommand: either it runs, or it has subcommands of its own."""

    name: str
    help: str
    options: tuple[Option, ...] = ()
    run: Callable[[argparse.Namespace], None] | None = None
    problem: Callable[[argparse.Namespace], str | None] = _no_problem
    """What is wrong with a combination of options, as a sentence; None where nothing is."""
    subcommands: tuple[Command, ...] = ()
    description: str | None = None
    """What ``--help`` says above the arguments."""


@contextmanager
def workshop(task: str) -> Iterator[None]:
    """Import the workshop inside this block; where it is not installed, raise ConfigError that says how to install it.

    `task` is what the workshop is needed for, as a verb: "diagnose".
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("pentimento"):
            raise
        raise ConfigError(
            f"To {task}, the workshop has to be installed, and {error.name} is missing: a robot's computer needs "
            "none of it. Where the pipeline runs, install it with: pip install '.[train]'."
        ) from error


def count(text: str) -> int:
    """Parse an integer of 1 or more."""
    return _integer(text, 1)


def seed(text: str) -> int:
    """Parse an integer of 0 or more."""
    return _integer(text, 0)


def length(text: str) -> float:
    """Parse a length above 0 with its unit, such as "4 mm"; in metres."""
    try:
        value = parse_quantity(text, "m")
    except PentimentoError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    if not value > 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not above 0")
    return value


def words(text: str) -> str:
    """Parse text; bytes that the terminal's encoding has no letters for are an error."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise argparse.ArgumentTypeError("it is not text in UTF-8") from error
    return text


def given(arguments: argparse.Namespace, names: tuple[str, ...]) -> list[str]:
    """Return those of the options `names` that the command line sets, as they are written there."""
    return [f"--{name.replace('_', '-')}" for name in names if getattr(arguments, name) not in (None, False)]


def _integer(text: str, minimum: int) -> int:
    try:
        number = int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from error
    if number < minimum:
        raise argparse.ArgumentTypeError(f"{number} is less than {minimum}")
    return number
