"""The text-image encoder, its convolutional stem and its folder layout."""

import json
from pathlib import Path

import pytest
import torch
from transformers import CLIPConfig, CLIPModel, CLIPTokenizer

from pentimento.contracts.errors import ConfigError
from pentimento.semantics.encoder import ConvolutionalCLIP, Encoder, EncoderShape, StemEmbeddings, has_stem, new_model
from tests.semantics.conftest import SHAPE


def test_embeddings_have_unit_length_at_any_picture_size(encoder: Encoder, images: torch.Tensor) -> None:
    for size in (16, 32, 50):
        resized = torch.nn.functional.interpolate(images[:3], (size, size))
        assert torch.allclose(encoder.embed_images(resized).norm(dim=-1), torch.ones(3), atol=1e-5)
    assert torch.allclose(encoder.embed_texts(["a", "a red house " * 50]).norm(dim=-1), torch.ones(2), atol=1e-5)


def test_embedding_gradient_equals_finite_differences(encoder: Encoder, images: torch.Tensor) -> None:
    image = images[:1].clone().requires_grad_()
    goal = encoder.embed_texts(["a house"])[0]
    (gradient,) = torch.autograd.grad((encoder.embed_images(image) @ goal).sum(), image)
    way = gradient / gradient.norm()
    step = 0.01
    with torch.no_grad():
        up, down = (encoder.embed_images(image + sign * step * way) @ goal for sign in (1, -1))
    assert float((up - down).sum() / (2 * step)) == pytest.approx(float(gradient.norm()), rel=0.05)


def test_patch_features_are_those_of_the_middle_layer(encoder: Encoder, images: torch.Tensor) -> None:
    features = encoder.patch_features(images[:2])
    out = encoder.model.vision_model(encoder.prepare(images[:2]), output_hidden_states=True)
    assert features.shape == (2, 4, SHAPE.image_width)
    assert torch.allclose(features, out.hidden_states[1][:, 1:], atol=1e-5)


def test_saved_encoder_has_the_published_layout_and_loads(
    encoder: Encoder, images: torch.Tensor, tmp_path: Path
) -> None:
    encoder.save(tmp_path)
    assert {"config.json", "model.safetensors", "vocab.json", "merges.txt"} <= {
        file.name for file in tmp_path.iterdir()
    }
    back = Encoder.load(tmp_path)
    assert back.digest == encoder.digest and len(back.digest) == 64
    assert torch.allclose(back.embed_images(images), encoder.embed_images(images), atol=1e-5)
    assert torch.allclose(back.embed_texts(["a red house"]), encoder.embed_texts(["a red house"]), atol=1e-5)


def test_encoder_digest_depends_on_the_weights(encoder: Encoder, tmp_path: Path) -> None:
    encoder.save(tmp_path)
    other = Encoder.load(tmp_path)
    with torch.no_grad():
        other.model.logit_scale += 1e-4
    assert other.digest != encoder.digest


def test_rejects_folder_without_clip_model(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is no folder of a CLIP model"):
        Encoder.load(tmp_path)
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "bert"}))
    with pytest.raises(ConfigError, match="of type 'bert'"):
        Encoder.load(tmp_path)
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "clip"}))
    with pytest.raises(ConfigError, match="cannot be read"):
        Encoder.load(tmp_path)


def test_loads_published_model_without_stem(encoder: Encoder, images: torch.Tensor, tmp_path: Path) -> None:
    config = CLIPConfig.from_dict(encoder.model.config.to_dict())
    del config.vision_config.convolutional_stem
    torch.manual_seed(0)
    published = Encoder(CLIPModel(config), encoder.tokenizer)
    published.save(tmp_path)
    back = Encoder.load(tmp_path)
    assert type(back.model) is CLIPModel and back.digest == published.digest
    assert torch.allclose(back.embed_images(images), published.embed_images(images), atol=1e-5)


def test_rejects_impossible_encoder_shapes() -> None:
    with pytest.raises(ValueError, match="multiple of patch_px"):
        EncoderShape(60, 8, 32, 1, 16, 1, 2, 16)
    with pytest.raises(ValueError, match="another power of 2"):
        EncoderShape(60, 10, 32, 1, 16, 1, 2, 16)
    with pytest.raises(ValueError, match="multiples of 3"):
        EncoderShape(64, 8, 32, 1, 16, 1, 3, 16)


STEM_SHAPE = EncoderShape(
    image_px=32, patch_px=4, image_width=32, image_layers=1, text_width=16, text_layers=1, heads=4, embedding=16
)


@pytest.fixture
def embeddings(tokenizer: CLIPTokenizer) -> StemEmbeddings:
    encoder = Encoder(new_model(STEM_SHAPE, tokenizer, 0), tokenizer)
    assert isinstance(encoder.model, ConvolutionalCLIP) and has_stem(encoder.model.config.to_dict())
    found: StemEmbeddings = encoder.model.vision_model.embeddings
    return found


def test_stem_gives_one_token_per_patch_and_a_class_token(embeddings: StemEmbeddings) -> None:
    assert embeddings(torch.rand(2, 3, 32, 32)).shape == (2, 1 + 8 * 8, 32)


def test_stem_is_local(embeddings: StemEmbeddings) -> None:
    blank = torch.zeros(1, 3, 32, 32)
    spot = blank.clone()
    spot[..., 13:15, 17:19] = 1
    changed = (embeddings(spot) - embeddings(blank))[0, 1:].abs().amax(1).view(8, 8) > 1e-6
    rows, columns = torch.nonzero(changed, as_tuple=True)
    assert changed[3, 4]
    assert int((rows - 3).abs().max()) <= 2 and int((columns - 4).abs().max()) <= 2


def test_class_token_of_the_stem_is_independent_of_position(embeddings: StemEmbeddings) -> None:
    pictures = torch.zeros(2, 3, 32, 32)
    thing = torch.rand(3, 4, 4, generator=torch.Generator().manual_seed(0))
    pictures[0, :, 12:16, 12:16], pictures[1, :, 16:20, 12:16] = thing, thing
    first, other = embeddings(pictures)
    assert torch.allclose(first[0], other[0], atol=1e-6)
    assert not torch.allclose(first[1:], other[1:], atol=1e-3)


def test_stem_rejects_interpolated_positions(embeddings: StemEmbeddings) -> None:
    with pytest.raises(ValueError, match="not interpolated"):
        embeddings(torch.zeros(1, 3, 32, 32), interpolate_pos_encoding=True)
