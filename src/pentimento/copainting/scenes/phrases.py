"""Words for things, as a person who asks for them says them."""

from __future__ import annotations

from collections.abc import Sequence


def phrase(kind: str, color: str | None = None) -> str:
    """A thing with its article: "an orange cup"."""
    words = kind if color is None else f"{color} {kind}"
    return f"{'an' if words[0] in 'aeiou' else 'a'} {words}"


def listed(phrases: Sequence[str]) -> str:
    """A car, a tree and a sun."""
    return phrases[0] if len(phrases) == 1 else f"{', '.join(phrases[:-1])} and {phrases[-1]}"
