"""What a subcommand says where the workshop that it needs is not installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pentimento.contracts.errors import ConfigError


@contextmanager
def workshop(to: str) -> Iterator[None]:
    """For imports of the workshop, needed ``to`` do something: where it is not installed, say how to install it."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("pentimento"):
            raise
        raise ConfigError(
            f"To {to}, the workshop has to be installed, and {error.name} is missing: a robot's computer needs "
            "none of it. Where the pipeline runs, install it with: pip install '.[train]'."
        ) from error
