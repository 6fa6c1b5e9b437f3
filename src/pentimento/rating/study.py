"""What a study asks people about pictures, read from a TOML file in `studies/` or of your own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from pentimento.contracts.codec import find_toml, from_plain, read_toml
from pentimento.contracts.errors import ConfigError

_SHIPPED: Final = Path(__file__).parent / "studies"
SHIPPED: Final = tuple(sorted(file.stem for file in _SHIPPED.glob("*.toml")))
"""Names of the studies that come with the package."""
_LEFT_RIGHT: Final = {"1": "the left one", "2": "the right one"}


@dataclass(frozen=True)
class Study:
    """The form of a study and its words."""

    form: Literal["choice", "match", "panel"]
    """choice: one of two pictures, the first condition's and another one's. match: which condition's picture goes with
    the reference. panel: each picture on a scale."""
    reference: Literal["none", "picture", "text"]
    """What is shown beside the pictures: of each item, or of each condition where the form is match."""
    title: str
    introduction: str
    ties: tuple[str, ...]
    """Answers that prefer neither picture; form choice."""
    points: int
    """Of the scale, from 1; form panel, else 0."""
    questions: dict[str, str]
    """The question by its name in the table of answers."""

    def __post_init__(self) -> None:
        if not self.questions:
            raise ValueError("questions is empty; write one or more, each as a name and a sentence.")
        if (self.points >= 2) != (self.form == "panel") or self.points not in range(0, 12):
            raise ValueError(f"points is {self.points}; a panel has 2 to 11, other forms have 0.")
        if self.ties and self.form != "choice":
            raise ValueError("ties belong to the form choice alone; write ties = [].")
        if self.form == "match" and self.reference != "picture":
            raise ValueError(f"reference is {self.reference!r}; the form match needs a picture of each condition.")

    def choices(self, shown: int) -> dict[str, str]:
        """What can be answered about so many pictures: the value that is saved, and its words on the page."""
        if self.form == "panel":
            ends = {1: "1, least", self.points: f"{self.points}, most"}
            return {str(point): ends.get(point, str(point)) for point in range(1, self.points + 1)}
        if self.form == "match":
            return {str(place): str(place) for place in range(1, shown + 1)}
        return _LEFT_RIGHT | {tie: tie for tie in self.ties}


def read_study(name_or_path: str | Path) -> Study:
    """A shipped study by its name, or one of your own by the path of its .toml file.

    Raises:
        ConfigError: there is none, or it says something else than a `Study`.
    """
    path = find_toml(name_or_path, _SHIPPED, "study")
    return from_plain(Study, read_toml(path, "study"), str(path), ConfigError)
