"""Ranges of a config dataclass's numbers, for its `__post_init__`."""

from typing import Any


def at_least(config: Any, minimum: float, *names: str) -> None:
    """Raise ValueError, a sentence, for the first of these fields that is below `minimum` (or NaN)."""
    for name in names:
        if not getattr(config, name) >= minimum:
            raise ValueError(f"{name} is {getattr(config, name)}; it must be {minimum} or more.")


def above_zero(config: Any, *names: str) -> None:
    """Raise ValueError, a sentence, for the first of these fields that is not above 0."""
    for name in names:
        if not getattr(config, name) > 0:
            raise ValueError(f"{name} is {getattr(config, name)}; it must be above 0.")
