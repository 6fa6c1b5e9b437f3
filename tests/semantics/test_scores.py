"""Scores in closed form, by an encoder with known vectors."""

from collections.abc import Sequence

import pytest
import torch

from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import clip_score, mismatched_quantile, object_scores, recognised, retrieval

WORDS = ["red", "green", "blue"]


class KnownEncoder(Encoder):
    """A picture's vector is its mean colour, a caption's vector the colours that it names."""

    def __init__(self) -> None:
        pass

    def embed_images(self, images: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.normalize(images.mean((2, 3)), dim=-1)

    def embed_texts(self, captions: Sequence[str]) -> torch.Tensor:
        named = torch.tensor([[float(word in caption) for word in WORDS] for caption in captions])
        return torch.nn.functional.normalize(named, dim=-1)


IMAGES = torch.eye(3)[:, :, None, None].expand(3, 3, 4, 4)


def test_clip_score_is_the_cosine() -> None:
    scores = clip_score(KnownEncoder(), IMAGES, ["a red", "a red", "blue and green"])
    assert scores.tolist() == pytest.approx([1.0, 0.0, 0.5**0.5])


def test_mismatched_quantile_excludes_own_captions() -> None:
    captions = ["a red", "a green", "a blue"]
    assert mismatched_quantile(KnownEncoder(), IMAGES, captions, q=1.0, seed=0) == 0.0
    with pytest.raises(ValueError, match="no mismatched pair"):
        mismatched_quantile(KnownEncoder(), IMAGES, ["a red"] * 3, q=0.5, seed=0)


def test_retrieval_of_a_perfect_encoder_is_perfect() -> None:
    found = retrieval(KnownEncoder(), IMAGES, ["a red", "a green", "a blue"], among=3, seed=0)
    assert found == {"image_to_text": 1.0, "text_to_image": 1.0, "chance": pytest.approx(1 / 3)}
    turned = retrieval(KnownEncoder(), IMAGES, ["a green", "a blue", "a red"], among=3, seed=0)
    assert turned["image_to_text"] == 0.0


def test_recognised_kinds_are_the_k_best() -> None:
    scores = object_scores(KnownEncoder(), IMAGES, WORDS)
    assert torch.equal(scores, torch.eye(3))
    assert recognised(scores[:2], WORDS, [["red"], ["red"]]) == [[True], [False]]
    mixed = torch.tensor([[0.9, 0.5, 0.1]])
    assert recognised(mixed, WORDS, [["green", "blue"]]) == [[True, False]]
    assert recognised(mixed, WORDS, [["red", "green"]]) == [[True, True]]
