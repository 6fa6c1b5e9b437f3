"""The convolutional stem: neighbours first, what is in a picture wherever it is, and the published config around it."""

import pytest
import torch
from transformers import CLIPTokenizer

from pentimento.semantics.encoder import Encoder, EncoderShape, new_model
from pentimento.semantics.stem import ConvolutionalCLIP, StemEmbeddings, has_stem

SHAPE = EncoderShape(
    image_px=32, patch_px=4, image_width=32, image_layers=1, text_width=16, text_layers=1, heads=4, embedding=16
)


@pytest.fixture
def embeddings(tokenizer: CLIPTokenizer) -> StemEmbeddings:
    encoder = Encoder(new_model(SHAPE, tokenizer, 0), tokenizer)
    assert isinstance(encoder.model, ConvolutionalCLIP) and has_stem(encoder.model.config.to_dict())
    found: StemEmbeddings = encoder.model.vision_model.embeddings
    return found


def test_there_are_as_many_tokens_as_patches_and_one_of_the_class(embeddings: StemEmbeddings) -> None:
    assert embeddings(torch.rand(2, 3, 32, 32)).shape == (2, 1 + 8 * 8, 32)


def test_a_spot_changes_the_places_near_it_only(embeddings: StemEmbeddings) -> None:
    blank = torch.zeros(1, 3, 32, 32)
    spot = blank.clone()
    spot[..., 13:15, 17:19] = 1
    changed = (embeddings(spot) - embeddings(blank))[0, 1:].abs().amax(1).view(8, 8) > 1e-6
    rows, columns = torch.nonzero(changed, as_tuple=True)
    assert changed[3, 4]
    assert int((rows - 3).abs().max()) <= 2 and int((columns - 4).abs().max()) <= 2


def test_the_class_token_starts_with_the_same_wherever_a_thing_is(embeddings: StemEmbeddings) -> None:
    pictures = torch.zeros(2, 3, 32, 32)
    thing = torch.rand(3, 4, 4, generator=torch.Generator().manual_seed(0))
    pictures[0, :, 12:16, 12:16], pictures[1, :, 16:20, 12:16] = thing, thing
    first, other = embeddings(pictures)
    assert torch.allclose(first[0], other[0], atol=1e-6)
    assert not torch.allclose(first[1:], other[1:], atol=1e-3)


def test_positions_are_not_interpolated(embeddings: StemEmbeddings) -> None:
    with pytest.raises(ValueError, match="not interpolated"):
        embeddings(torch.zeros(1, 3, 32, 32), interpolate_pos_encoding=True)
