"""The start of attention: each head looks at its neighbour, white paper is nothing, places come through all layers."""

import math

import pytest
import torch
from transformers import CLIPTokenizer

from pentimento.semantics.encoder import Encoder, EncoderShape, new_model, normalise
from pentimento.semantics.locality import _NEIGHBOURS, _frequencies, _places, _turn

SHAPE = EncoderShape(
    image_px=32, patch_px=4, image_width=128, image_layers=2, text_width=32, text_layers=1, heads=8, embedding=16
)


@pytest.fixture(scope="module")
def fresh(tokenizer: CLIPTokenizer) -> Encoder:
    return Encoder(new_model(SHAPE, tokenizer, 0), tokenizer)


@pytest.mark.parametrize("side", [2, 4, 8])
def test_places_are_orthogonal_and_turned_into_their_neighbours(side: int) -> None:
    waves = _frequencies(side, side)
    places = _places(side, waves)
    products = (places @ places.T).view(side, side, side, side)
    middle = products[side // 2, side // 2]
    expected = torch.zeros(side, side)
    expected[side // 2] += side / 2
    expected[:, side // 2] += side / 2
    assert torch.allclose(middle, expected, atol=1e-5)
    moved = (places @ _turn((1, 0), waves).T).view(side, side, -1)
    assert torch.allclose(moved[:-1], places.view(side, side, -1)[1:], atol=1e-5)


def test_each_head_looks_at_its_neighbour_first_exactly_then_mostly(fresh: Encoder) -> None:
    images = torch.rand(2, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    seen = fresh.model.vision_model(fresh.prepare(images), output_attentions=True).attentions
    assert len(seen) == 2
    for attention, share in zip(seen, (1.0, 0.6), strict=True):  # [B, heads, 65, 65]
        for head, (down, right) in enumerate(_NEIGHBOURS):
            most = attention[0, head, 1:, 1:].argmax(-1).view(8, 8)
            rows, columns = torch.meshgrid(torch.arange(1, 7), torch.arange(1, 7), indexing="ij")
            right_place = most[1:7, 1:7] == (rows + down) * 8 + columns + right
            assert right_place.double().mean() >= share


def test_the_class_token_starts_with_the_mean_of_all_patches(fresh: Encoder) -> None:
    images = torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(1))
    (first, *_) = fresh.model.vision_model(fresh.prepare(images), output_attentions=True).attentions
    assert torch.allclose(first[0, :, 0], torch.full((8, 65), 1 / 65), atol=1e-4)


def test_white_paper_adds_nothing_to_its_place(fresh: Encoder) -> None:
    white = normalise(torch.ones(1, 3, 32, 32))
    states = fresh.model.vision_model.embeddings(white)[0, 1:]
    places = _places(8, _frequencies(8, 4))
    assert torch.allclose(states[:, : places.shape[1]], places, atol=1e-4)
    assert states[:, places.shape[1] :].abs().max() < 1e-4
    assert float(places.norm(dim=-1).mean()) == pytest.approx(math.sqrt(8))
