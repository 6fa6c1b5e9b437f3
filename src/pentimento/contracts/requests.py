"""What people ask the goal planner for, in words."""

from typing import Final

MARKER_WORDS: Final = "with a marker"
COLOUR_WORDS: Final = "in colours"
"""What a request says of the medium."""


def with_medium(caption: str, medium: str) -> str:
    """A request that names its medium: "a cat, with a marker"; without a caption, it names none."""
    return f"{caption}, {medium}" if caption else ""
