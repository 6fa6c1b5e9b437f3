"""The autoencoder: its training, the scale of its latents, and its reconstructions of ink."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import avg_pool2d

from pentimento.contracts import scenes
from pentimento.contracts.images import decode_png
from pentimento.copainting.goal.vae import (
    DecoderConfig,
    VaeConfig,
    _colour_loss,
    _random_crops,
    as_model_input,
    as_pictures,
    encode,
    ink_after_round_trip,
    round_trip,
    train_decoder,
    train_vae,
    vae_pictures,
)

CONFIG = VaeConfig(channels=(16, 16), latent_channels=4, pictures=16, steps=40, batch=2, learning_rate=3e-3)


@pytest.fixture(scope="module")
def drawn() -> list[np.ndarray]:
    return [decode_png(row["image"]["bytes"]) for row in scenes.example_table(16).to_pylist()]


def test_autoencoder_training_lowers_the_error_and_sets_the_scaling_factor(drawn: list[np.ndarray]) -> None:
    pictures = vae_pictures(drawn, 0)
    assert pictures.shape == (48, 64, 64, 3)
    steps: list[int] = []
    vae = train_vae(pictures, CONFIG, 0, log=lambda _name, _value, step: steps.append(step))
    assert steps == list(range(CONFIG.steps))
    untrained = train_vae(pictures, replace(CONFIG, steps=1, learning_rate=1e-9), 0, log=lambda *_: None)
    before, after = (np.abs(round_trip(v, pictures).astype(float) - pictures).mean() for v in (untrained, vae))
    assert after < 0.6 * before
    latents = encode(vae, pictures)
    assert latents.shape == (48, 4, 32, 32)
    assert float((latents * vae.config.scaling_factor).std()) == pytest.approx(1, abs=0.05)
    again = train_vae(pictures, CONFIG, 0, log=lambda *_: None)
    assert all(torch.equal(a, b) for a, b in zip(vae.state_dict().values(), again.state_dict().values(), strict=True))


def test_decoder_training_improves_reconstructions_and_keeps_latents(drawn: list[np.ndarray]) -> None:
    vae = train_vae(vae_pictures(drawn, 0), CONFIG, 0, log=lambda *_: None)
    pictures = vae_pictures(drawn, 1)[16:32]  # pen drawings
    latents, before = encode(vae, pictures), round_trip(vae, pictures)
    steps: list[int] = []
    train_decoder(vae, pictures, DecoderConfig(25, 4, 1e-3), seed=0, log=lambda _name, _value, step: steps.append(step))
    assert steps == list(range(25)) and torch.equal(encode(vae, pictures), latents)
    errors = [np.abs(result.astype(float) - pictures).mean() for result in (before, round_trip(vae, pictures))]
    assert errors[1] < 0.9 * errors[0]
    assert not any(parameter.requires_grad for parameter in vae.parameters())


def test_ink_scores_of_an_untrained_autoencoder_are_low(drawn: list[np.ndarray]) -> None:
    vae = train_vae(vae_pictures(drawn[:2], 0), replace(CONFIG, steps=1, learning_rate=1e-9), 0, log=lambda *_: None)
    scores = ink_after_round_trip(vae, drawn[:4], 0)
    # What it makes is all alike: either all of the ink is lost, or everything is ink.
    assert all((kind["recall"] or 0.0) * (kind["precision"] or 0.0) < 0.6 for kind in scores.values())
    assert round_trip(vae, np.stack(drawn[:4])).shape == (4, 64, 64, 3)


def test_pictures_convert_to_model_input_and_back() -> None:
    pictures = np.random.default_rng(0).integers(0, 256, (2, 4, 6, 3)).astype(np.uint8)
    shown = as_model_input(pictures)
    assert shown.shape == (2, 3, 4, 6) and float(shown.abs().max()) <= 1
    assert (as_pictures(shown) == pictures).all()


def test_crops_are_parts_of_their_pictures() -> None:
    images = torch.arange(2 * 3 * 12 * 10, dtype=torch.float32).reshape(2, 3, 12, 10)
    crops = _random_crops(images, 8, torch.Generator().manual_seed(0))
    assert crops.shape == (2, 3, 8, 8)
    for crop, image in zip(crops, images, strict=True):
        (row, column) = np.argwhere(image[0].numpy() == float(crop[0, 0, 0]))[0]
        assert (image[:, row : row + 8, column : column + 8] == crop).all()


def test_colour_loss_is_zero_for_the_pictures_themselves_and_the_mean_opponent_colours_of_their_cells() -> None:
    pictures = torch.rand((2, 3, 16, 24), generator=torch.Generator().manual_seed(1)) * 2 - 1
    red, green, blue = avg_pool2d(pictures, 8).unbind(1)
    latents = torch.zeros((2, 5, 2, 3))
    latents[:, 3], latents[:, 4] = 2 * (red - green), 2 * (blue - (red + green) / 2)
    assert float(_colour_loss(pictures, pictures, latents)) < 1e-10
    grey = pictures.mean(1, keepdim=True)
    assert float(_colour_loss(pictures + grey, pictures, latents)) < 1e-6  # lightness is not its concern
    tinted = pictures + torch.tensor([0.1, 0.0, 0.0])[:, None, None]
    assert float(_colour_loss(tinted, pictures, latents)) == pytest.approx((0.1 + 0.05) / 2, rel=1e-4)
