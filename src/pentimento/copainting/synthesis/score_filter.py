"""Which paintings show what their captions say: a threshold of CLIPScore (thesis 6.4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.ranges import at_least
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import mismatched_quantile


@dataclass(frozen=True)
class Threshold:
    """The least score that a painting needs: a number, or a quantile of the scores with captions of others."""

    score: float | None
    """A cosine, for a published encoder. The thesis's CLIPScore of .5 is one of .2 (times 2.5; Hessel et al. 2021)."""
    mismatched_quantile: float | None
    """For any encoder: with .95, one painting in 20 would pass with a caption that is not its own."""
    seed: int
    """Of which other captions each painting meets, where there are many."""

    def __post_init__(self) -> None:
        at_least(self, 0, "seed")
        if (self.score is None) == (self.mismatched_quantile is None):
            raise ValueError(
                f"score is {self.score} and mismatched_quantile {self.mismatched_quantile}; give one of them, the "
                "other null."
            )
        if self.mismatched_quantile is not None and not 0 <= self.mismatched_quantile <= 1:
            raise ValueError(f"mismatched_quantile is {self.mismatched_quantile}; it runs from 0 to 1.")


def min_score(config: Threshold, encoder: Encoder, pictures: Tensor, captions: Sequence[str]) -> float:
    """The threshold as a number, for full paintings [B, 3, H, W] (sRGB in [0, 1]) with their captions.

    Raises:
        ConfigError: a quantile is asked for, but all captions are the same.
    """
    if config.score is not None:
        return config.score
    assert config.mismatched_quantile is not None  # __post_init__ saw to it
    try:
        return mismatched_quantile(encoder, pictures, captions, config.mismatched_quantile, config.seed)
    except ValueError as error:
        raise ConfigError(f"{error} Set threshold.score, or paint scenes with other captions.") from None
