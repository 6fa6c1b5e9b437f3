"""What a new tool or material may be called."""

from __future__ import annotations

import re
from collections.abc import Collection

from pentimento.contracts.errors import ConfigError

_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


def check_name(name: str, what: str, taken: Collection[str]) -> None:
    """Raise ConfigError unless a name can stand in folders, stages and parameters, and is not in use."""
    if _NAME.fullmatch(name) is None or name.endswith("_"):
        raise ConfigError(
            f"{name!r} cannot name a {what}: write small letters, digits and underscores, a letter first, such as "
            "angled_brush."
        )
    if name.endswith("_base") or name.startswith("push_"):
        raise ConfigError(
            f"{name!r} cannot name a {what}: folders of models end in _base and begin with push_ for reasons of their "
            "own; choose another name."
        )
    if name in taken:
        raise ConfigError(f"{name!r} is there already: nothing was changed. Choose another name for the new {what}.")


def check_like(like: str, what: str, known: Collection[str]) -> None:
    """Raise ConfigError unless the model to follow is known."""
    if like not in known:
        raise ConfigError(f"There is no {what} {like!r} in the pipeline to follow; known are {', '.join(known)}.")
