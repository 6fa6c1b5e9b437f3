"""Gaps and shares against closed forms."""

import numpy as np
import pytest
import torch

from pentimento.copainting.evaluation.measures import (
    as_tensor,
    changed_share,
    delta_pix,
    delta_sem,
    inked_share,
    surviving_ink,
)
from pentimento.semantics.encoder import Encoder, EncoderShape, new_model
from pentimento.semantics.tokenizer import learn_tokenizer

WHITE = np.full((2, 16, 16, 3), 255, np.uint8)


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    torch.set_num_threads(1)
    tokenizer = learn_tokenizer(["a red disc", "a blue square"], 20, 12)
    return Encoder(new_model(EncoderShape(16, 8, 32, 2, 16, 1, 2, 16), tokenizer, 0), tokenizer)


def test_delta_pix_is_the_mean_squared_difference_whatever_the_size() -> None:
    grey = np.full_like(WHITE, 204)  # 255 - 51 = a fifth
    assert delta_pix(WHITE, grey) == pytest.approx([0.04, 0.04])
    large = np.full((1, 64, 64, 3), 255, np.uint8)
    assert delta_pix(large, large - 51) == pytest.approx([0.04])
    assert (delta_pix(grey, grey) == 0).all()


def test_delta_sem_is_a_distance_of_meanings(encoder: Encoder) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (2, 16, 16, 3)).astype(np.uint8)
    assert delta_sem(encoder, noise, noise) == pytest.approx([0, 0], abs=1e-6)
    apart = delta_sem(encoder, WHITE, noise)
    assert ((apart > 0) & (apart <= 2)).all()
    assert apart == pytest.approx(delta_sem(encoder, noise, WHITE), abs=1e-6)
    one, other = (encoder.embed_images(as_tensor(p)).detach().numpy() for p in (WHITE, noise))
    assert apart == pytest.approx(1 - (one * other).sum(-1), abs=1e-5)


def test_ink_survives_a_shift_of_one_pixel_and_not_of_two() -> None:
    drawn = WHITE.copy()
    drawn[0, :, 8] = 0
    shifts = [surviving_ink(drawn, np.roll(drawn, by, axis=2))[0] for by in (0, 1, 2)]
    assert shifts == [1, 1, 0]
    assert np.isnan(surviving_ink(drawn, drawn)[1])  # no ink that could survive
    assert inked_share(drawn) == pytest.approx([1 / 16, 0])


def test_changed_pixels_are_counted_from_the_least_change_on() -> None:
    other = WHITE.copy()
    other[0, :4, :, 1] -= 64
    other[1, :4, :, 1] -= 63
    assert changed_share(WHITE, other) == pytest.approx([0.25, 0])
