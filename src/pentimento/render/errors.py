"""The renderer's error."""

from __future__ import annotations

from pentimento.contracts.errors import PentimentoError


class RenderInputError(PentimentoError):
    """An input of the renderer has a wrong shape, a value that is not finite or too large, or needs too much memory."""
