"""The CLIPScore threshold of a dataset."""

from pathlib import Path

import pytest
import torch

from pentimento.contracts.errors import ConfigError
from pentimento.copainting.synthesis.dataset import Threshold, min_score
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import clip_score
from tests.copainting.painters import write_encoder

CAPTIONS = ["a red disc on a white ground", "a blue square on a grey ground", "a green disc on a white ground"]


def test_threshold_is_a_number_or_a_quantile_of_mismatched_scores(tmp_path: Path) -> None:
    encoder = Encoder.load(write_encoder(tmp_path / "encoder"))
    pictures = torch.rand(3, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    assert min_score(Threshold(0.5, None, 0), encoder, pictures, CAPTIONS) == 0.5
    scores = [min_score(Threshold(None, q, 0), encoder, pictures, CAPTIONS) for q in (0.0, 0.5, 1.0)]
    wrong = [clip_score(encoder, pictures, CAPTIONS[turn:] + CAPTIONS[:turn]) for turn in (1, 2)]
    assert scores[0] == pytest.approx(float(torch.cat(wrong).min()), abs=1e-6)
    assert scores[2] == pytest.approx(float(torch.cat(wrong).max()), abs=1e-6)
    assert scores[0] < scores[1] < scores[2]
    with pytest.raises(ConfigError, match=r"All captions are the same.*threshold\.score"):
        min_score(Threshold(None, 0.5, 0), encoder, pictures, CAPTIONS[:1] * 3)


@pytest.mark.parametrize("values", [(None, None), (0.5, 0.5), (None, 1.5)])
def test_rejects_threshold_with_both_or_neither_value(values: tuple[float | None, float | None]) -> None:
    with pytest.raises(ValueError, match=r"score is|mismatched_quantile is"):
        Threshold(*values, 0)
