"""What the renderer refuses."""

from __future__ import annotations

from pentimento.contracts.errors import PentimentoError


class RenderInputError(PentimentoError):
    """An input of the renderer has a wrong shape, a value that is not finite or absurdly large, or needs too much."""
