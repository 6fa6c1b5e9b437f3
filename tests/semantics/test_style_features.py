"""Local features respond to colour, scale and orientation, and cover the picture."""

import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ConfigError
from pentimento.dynamics.strokes.photometry import linear_to_srgb
from pentimento.semantics.style_features import CELL_PX, OPPONENT, LocalFeatures, cell_means, gabor_bank
from tests.semantics.test_earth_movers import points
from tests.semantics.textures import soft_blobs

FEATURES = LocalFeatures()


def test_gabor_bank_gives_a_grating_its_amplitude_at_every_phase() -> None:
    bank = gabor_bank(4).double()[:, 0]
    assert float(bank.sum((1, 2)).abs().max()) < 1e-6
    steps = torch.arange(7, dtype=torch.float64) - 3
    y, x = torch.meshgrid(steps, steps, indexing="ij")
    for index, turn in enumerate(np.pi * np.arange(4) / 4):
        for phase in np.linspace(0, np.pi, 7):
            grating = torch.cos(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / 4 + phase)
            modulus = (bank * grating).sum((1, 2)).unflatten(0, (4, 2)).norm(dim=1)
            assert float(modulus[index]) == pytest.approx(1, abs=0.02)
            assert int(modulus.argmax()) == index


def test_uniform_picture_has_its_colour_and_no_contrast() -> None:
    color = torch.tensor([0.5, 0.2, 0.05])
    cells = FEATURES(color.expand(50, 70, 3))
    assert cells.shape == (3 * 4, 49)
    opponent = torch.tensor(OPPONENT) @ linear_to_srgb(color)
    torch.testing.assert_close(cells[:, :3], opponent.expand(12, 3))
    assert float(cells[:, 3:].abs().max()) < 1e-5


@pytest.mark.parametrize("period", [4, 8, 16, 32])
def test_each_scale_responds_to_its_period_and_orientation(period: int) -> None:
    wave = 0.5 + 0.2 * torch.cos(2 * np.pi * (torch.arange(192) + 0.5) / period)
    upright = (wave**2.2)[None, :, None].expand(192, 192, 3)  # about a cosine in sRGB
    contrast = FEATURES(upright).reshape(12, 12, 49)[3:9, 3:9, 9:].mean((0, 1))
    light = torch.stack([contrast[0:4], contrast[4:8], contrast[16:20], contrast[28:32]])  # by scale, then orientation
    assert divmod(int(light.argmax()), 4) == (int(np.log2(period / 4)), 0)
    turned = FEATURES(upright.transpose(0, 1)).reshape(12, 12, 49)[3:9, 3:9, 9:].mean((0, 1))
    torch.testing.assert_close(turned[[0, 1, 2, 3]], contrast[[2, 1, 0, 3]], rtol=1e-3, atol=1e-4)


def test_features_separate_dark_blue_on_light_yellow_from_the_reverse() -> None:
    """Both have nearly the same mean and contrasts of light and of colour; it is their going together that differs."""
    sign = torch.tensor(np.random.default_rng(0).choice([-1.0, 1.0], (24, 24)), dtype=torch.float32)
    sign = sign.repeat_interleave(8, 0).repeat_interleave(8, 1)[..., None]
    light, yellow = torch.tensor([0.12, 0.12, 0.12]), torch.tensor([0.06, 0.06, -0.12])
    with_, against = ((0.5 + sign * (light + turn * yellow)) ** 2.2 for turn in (1, -1))
    one, other = (FEATURES(image).mean(0) for image in (with_, against))
    together = (one - other)[3:9].abs().max()
    assert float(together) > 0.1
    rest = torch.cat([(one - other)[:3], (one - other)[9:]]).abs().max()
    assert float(rest) < 0.25 * float(together)


@pytest.mark.parametrize(("height", "width"), [(16, 16), (17, 31), (150, 203)])
def test_features_cover_odd_and_small_pictures(height: int, width: int) -> None:
    image = soft_blobs(height, width, 0).requires_grad_(True)
    cells = FEATURES(image)
    assert len(cells) == round(height / CELL_PX) * round(width / CELL_PX)
    (gradient,) = torch.autograd.grad(cells.square().sum(), image)
    assert bool((gradient.abs().amax(-1) > 0).all())


def test_cell_means_keep_the_mean() -> None:
    maps = points(7, 11, 0)
    torch.testing.assert_close(cell_means(maps, (3, 4)).mean(), maps.mean())
    torch.testing.assert_close(cell_means(maps, (7, 11)), maps)


def test_rejects_picture_smaller_than_a_cell() -> None:
    with pytest.raises(ConfigError, match=r"15 x 40 px has no local features: .*16 px or more"):
        FEATURES(torch.zeros(15, 40, 3))
