"""TrajVAE: a variational autoencoder of strokes in the standard frame (thesis 5.3.3; Kingma & Welling 2014)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor, nn

from pentimento.planning.strokes.latent import Array, Layer, StyleDecoder


class Strokes(NamedTuple):
    """B demonstrations in the standard frame."""

    xy_m: Tensor  # [B, N, 2]
    height_m: Tensor  # [B, N] of the tip over the paper, 0 where unknown
    height_known: Tensor  # [B] 0 or 1

    def pick(self, index: Tensor) -> Strokes:
        """The strokes with these indices."""
        return Strokes(*(field[index] for field in self))


class TrajVAE(nn.Module):
    """A stroke → a normal distribution of its latent; a latent → a stroke. Both are three-layer perceptrons."""

    def __init__(self, points: int, latent: int, width: int, scale_m: float, height_scale_m: float) -> None:
        """``scale_m`` and ``height_scale_m`` normalise places and heights."""
        super().__init__()
        self.points, self.latent, self.width = points, latent, width
        self.scale_m, self.height_scale_m = scale_m, height_scale_m
        self.encoder = _perceptron(3 * points + 1, width, 2 * latent)
        self.decoder = _perceptron(latent, width, 3 * points)
        self.waves = _waves(points)  # [modes, N], a constant

    def encode(self, strokes: Strokes) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation [B, latent] of each stroke's latent."""
        known = strokes.height_known[:, None]
        flat = torch.cat(
            [strokes.xy_m.flatten(1) / self.scale_m, known * strokes.height_m / self.height_scale_m, known], dim=1
        )
        mean, log_deviation = self.encoder(flat).chunk(2, dim=1)
        return mean, log_deviation.clamp(-6.0, 2.0).exp()

    def decode(self, latent: Tensor) -> tuple[Tensor, Tensor]:
        """Places [B, N, 2] and heights [B, N], metres, in the standard frame."""
        flat = self.decoder(latent)
        modes = flat[:, : 2 * self.points].reshape(-1, self.points, 2)
        xy = torch.einsum("bkd,kn->bnd", modes, self.waves)
        return xy * self.scale_m, flat[:, 2 * self.points :] * self.height_scale_m

    def loss(self, strokes: Strokes, kl_weight: float, generator: torch.Generator) -> Tensor:
        """Mean squared error of places and known heights, plus the weighted divergence.

        Errors of places are relative to the stroke's size, since a curl of 3 mm has as much shape as an arc of 50 mm.

        Args:
            kl_weight: weight of the Kullback-Leibler divergence of the latents from the standard normal distribution.
        """
        mean, deviation = self.encode(strokes)
        noise = torch.randn(mean.shape, generator=generator)
        xy, height = self.decode(mean + deviation * noise)
        size = sizes_m(strokes.xy_m)
        places = (xy - strokes.xy_m).square().sum(-1).mean(-1) / size.square()
        heights = ((height - strokes.height_m) / self.height_scale_m).square().mean(-1) * strokes.height_known
        kl = 0.5 * (mean.square() + deviation.square() - 2 * deviation.log() - 1).sum(-1)
        return (places + _HEIGHT_WEIGHT * heights + kl_weight * kl).mean()


_HEIGHT_WEIGHT = 0.02
"""Weight of heights relative to places. It is small, since planning chooses its own heights (thesis 5.3.3)."""


def _waves(points: int) -> Tensor:
    """Cosines [modes, N] of decreasing amplitude. Paths are sums of them, which favours smooth lines."""
    mode, n = torch.arange(points)[:, None], torch.arange(points)
    cosines = torch.cos(torch.pi * mode * (n + 0.5) / points)
    return cosines / (1 + mode * _DECAY)


_DECAY = 0.5
"""Decrease of the amplitude with the mode: mode k has 1 / (1 + k · decay)."""


def sizes_m(xy_m: Tensor) -> Tensor:
    """[B] root mean square distance of a stroke's points from their mean."""
    return (xy_m - xy_m.mean(1, keepdim=True)).square().sum(-1).mean(-1).sqrt()


def reconstruction_errors_mm(model: TrajVAE, strokes: Strokes) -> Tensor:
    """[B] mean distance, mm, of each stroke's points from their reconstruction from its mean latent."""
    with torch.no_grad():
        xy, _ = model.decode(model.encode(strokes)[0])
    errors: Tensor = (xy - strokes.xy_m).norm(dim=-1).mean(-1) * 1e3
    return errors


def _perceptron(inputs: int, width: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, width), nn.SiLU(), nn.Linear(width, width), nn.SiLU(), nn.Linear(width, outputs)
    )


def decoder_of(model: TrajVAE, strokes: Strokes, hand: str) -> StyleDecoder:
    """The model's decoder in numpy, with the latents of these demonstrations of a writer.

    Heights are left out, since planning chooses its own (thesis 5.3.3).
    """
    with torch.no_grad():
        mean, deviation = model.encode(strokes)
    linear = [module for module in model.decoder if isinstance(module, nn.Linear)]
    layers = [Layer(_array(module.weight.T), _array(module.bias)) for module in linear[:-1]]
    last = torch.cat([linear[-1].weight.T, linear[-1].bias[None]])[:, : 2 * model.points]  # [width + 1, 2 N]
    modes = last.reshape(-1, model.points, 2)
    of_points = torch.einsum("wkd,kn->wnd", modes, model.waves).flatten(1)
    layers.append(Layer(_array(of_points[:-1]), _array(of_points[-1])))
    return StyleDecoder(hand, tuple(layers), model.scale_m, _array(mean), _array(deviation))


def generic_decoder(model: TrajVAE) -> StyleDecoder:
    """The decoder without a writer: latents from the standard normal distribution."""
    nobody = Strokes(torch.zeros(1, model.points, 2), torch.zeros(1, model.points), torch.zeros(1))
    decoder = decoder_of(model, nobody, "nobody")
    mean = torch.zeros(1, model.latent)
    return replace(decoder, latent_mean=_array(mean), latent_deviation=_array(mean + 1))


def _array(values: Tensor) -> Array:
    return values.detach().contiguous().numpy().copy()
