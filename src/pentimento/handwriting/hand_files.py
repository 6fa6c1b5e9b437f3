"""From a trained TrajVAE to the file of a hand that planning reads without PyTorch."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from pentimento.handwriting.trajvae import Strokes, TrajVAE
from pentimento.planning.latent.decoder import Array, HandDecoder, Layer


def hand_of(model: TrajVAE, strokes: Strokes, hand: str) -> HandDecoder:
    """The model's decoder with the latents of the strokes that the hand was learned from. Heights are left out:
    planning chooses its own (thesis 5.3.3).
    """
    with torch.no_grad():
        mean, deviation = model.encode(strokes)
    linear = [module for module in model.decoder if isinstance(module, nn.Linear)]
    layers = [Layer(_array(module.weight.T), _array(module.bias)) for module in linear[:-1]]
    last = torch.cat([linear[-1].weight.T, linear[-1].bias[None]])[:, : 2 * model.points]  # [width + 1, 2 N]
    modes = last.reshape(-1, model.points, 2)
    of_points = torch.einsum("wkd,kn->wnd", modes, model.waves).flatten(1)
    layers.append(Layer(_array(of_points[:-1]), _array(of_points[-1])))
    return HandDecoder(hand, tuple(layers), model.scale_m, _array(mean), _array(deviation))


def generic_hand(model: TrajVAE) -> HandDecoder:
    """Nobody's: latents from the standard normal distribution, where no hand is known."""
    nobody = Strokes(torch.zeros(1, model.points, 2), torch.zeros(1, model.points), torch.zeros(1))
    decoder = hand_of(model, nobody, "nobody")
    mean = torch.zeros(1, model.latent)
    return replace(decoder, latent_mean=_array(mean), latent_deviation=_array(mean + 1))


def _array(values: Tensor) -> Array:
    return values.detach().contiguous().numpy().copy()
