"""What can go wrong in the middle of a painting, each told in one sentence: what, and what to do."""

from __future__ import annotations

from typing import Literal

from pentimento.contracts.errors import PentimentoError

Kind = Literal["camera", "moved", "slid", "hand", "no mark"]


class PaintingFault(PentimentoError):
    """It is not safe, or not sensible, to go on without a person. The tool is up; the state is on disk."""

    def __init__(self, kind: Kind, sentence: str) -> None:
        super().__init__(sentence)
        self.kind = kind
