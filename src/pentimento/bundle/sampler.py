"""Goal pictures from a canvas and words: Instruct-Pix2Pix (Brooks et al. 2023), sampled by DDIM, in numpy.

The networks come as plain callables, so that this file knows no runtime. What is done to their answers is what
diffusers' ``StableDiffusionInstructPix2PixPipeline`` does with ``DDIMScheduler`` (Song et al. 2021, eq. 12), drawing no
noise on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError

FloatImage = NDArray[np.float32]
Latents = NDArray[np.float32]

Prediction = Literal["epsilon", "v_prediction", "sample"]
Spacing = Literal["trailing", "leading"]


@dataclass(frozen=True, eq=False)
class NoiseSchedule:
    """How much of the picture is left in the noise at each timestep, and what the network foretells there."""

    alphas_cumprod: NDArray[np.float32]
    """[T]: share of the picture's variance, falling; the last is 0 with a zero terminal SNR (Lin et al. 2023)."""
    final_alpha: float
    """Of the picture itself: 1, or the first of ``alphas_cumprod`` for networks that were published so."""
    prediction: Prediction
    spacing: Spacing
    offset: int = 0
    """Added to each timestep where they are spaced from the front ("leading")."""

    def __post_init__(self) -> None:
        if self.prediction not in ("epsilon", "v_prediction", "sample") or self.spacing not in ("trailing", "leading"):
            raise ContractError(
                f"The noise schedule foretells {self.prediction!r} with {self.spacing!r} spacing; the sampler knows "
                "epsilon, v_prediction, sample and trailing, leading."
            )
        if self.prediction == "epsilon" and self.alphas_cumprod[-1] == 0:
            raise ContractError("A schedule that ends in pure noise cannot foretell the noise; it would tell nothing.")

    def timesteps(self, steps: int) -> NDArray[np.int64]:
        """[steps] from noise to picture."""
        count = len(self.alphas_cumprod)
        if not 1 <= steps <= count:
            raise ContractError(f"{steps} sampling steps are asked for; the network knows from 1 to {count}.")
        if self.spacing == "trailing":
            return np.round(np.arange(count, 0, -count / steps)).astype(np.int64) - 1
        return (np.arange(steps)[::-1] * (count // steps)).astype(np.int64) + self.offset


@dataclass(frozen=True)
class Networks:
    """The goal planner's parts; pictures [B, 3, H, W] run from −1 to 1."""

    read: Callable[[NDArray[np.int64]], NDArray[np.float32]]
    """Tokens [B, L] to text states [B, L, D]."""
    encode: Callable[[FloatImage], Latents]
    """Pictures to latents [B, C, h, w]: the mode, not scaled (so Instruct-Pix2Pix was trained)."""
    predict: Callable[[Latents, int, NDArray[np.float32]], Latents]
    """Latents beside those of the canvas [B, 2C, h, w], a timestep, text states [B, L, D] to [B, C, h, w]."""
    decode: Callable[[Latents], FloatImage]
    """Latents, divided by ``scaling``, to pictures."""
    scaling: float
    """Of the latents that are sampled."""


def complete(
    networks: Networks,
    schedule: NoiseSchedule,
    canvas: NDArray[np.uint8],
    tokens: NDArray[np.int64],
    no_words: NDArray[np.int64],
    noise: Latents,
    steps: int,
    image_guidance: float,
    text_guidance: float,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> NDArray[np.uint8]:
    """Goal pictures uint8 [B, H, W, 3] for canvases uint8 [B, H, W, 3] and captions.

    Args:
        tokens: [B, L] of the captions.
        no_words: [1, L] of the empty caption.
        noise: [B, C, h, w], standard normal.
        image_guidance: s_I of Brooks et al., eq. 3; without effect where ``text_guidance`` is 1, as published.
        text_guidance: s_T; above 1, the network is asked three times in each step.
        progress: told (steps done, steps) after each step.
    """
    guided = text_guidance > 1 and image_guidance >= 1
    shown = networks.encode(_as_input(canvas))
    text = networks.read(tokens)
    if guided:
        blank = np.repeat(networks.read(no_words), len(canvas), axis=0)
        text = np.concatenate([text, blank, blank])
        shown = np.concatenate([shown, shown, np.zeros_like(shown)])
    latents = noise.astype(np.float32)
    apart = len(schedule.alphas_cumprod) // steps
    for number, timestep in enumerate(schedule.timesteps(steps)):
        asked = np.concatenate([np.concatenate([latents] * 3) if guided else latents, shown], axis=1)
        told = networks.predict(asked, int(timestep), text)
        if guided:
            both, image_only, neither = np.split(told, 3)
            told = neither + text_guidance * (both - image_only) + image_guidance * (image_only - neither)
        latents = _step(schedule, told, int(timestep), int(timestep) - apart, latents)
        progress(number + 1, steps)
    return _as_uint8(networks.decode((latents / networks.scaling).astype(np.float32)))


def round_trip(networks: Networks, pictures: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pictures uint8 [B, H, W, 3] as they come back from the autoencoder."""
    return _as_uint8(networks.decode(networks.encode(_as_input(pictures))))


def _as_input(pictures: NDArray[np.uint8]) -> FloatImage:
    """uint8 [B, H, W, 3] as [B, 3, H, W] from −1 to 1."""
    return (pictures.transpose(0, 3, 1, 2) / 127.5 - 1).astype(np.float32)


def _as_uint8(pictures: FloatImage) -> NDArray[np.uint8]:
    """[B, 3, H, W] from −1 to 1 as uint8 [B, H, W, 3]."""
    return np.round(np.clip(pictures / 2 + 0.5, 0, 1).transpose(0, 2, 3, 1) * 255).astype(np.uint8)


def _step(schedule: NoiseSchedule, told: Latents, now: int, then: int, latents: Latents) -> Latents:
    """Latents at timestep ``then`` from those at ``now`` (Song et al. 2021, eq. 12 with σ = 0)."""
    alpha = float(schedule.alphas_cumprod[now])
    next_alpha = float(schedule.alphas_cumprod[then]) if then >= 0 else schedule.final_alpha
    signal, noisy = alpha**0.5, (1 - alpha) ** 0.5
    match schedule.prediction:
        case "epsilon":
            picture, noise = (latents - noisy * told) / signal, told
        case "sample":
            picture, noise = told, (latents - signal * told) / noisy
        case "v_prediction":
            picture, noise = signal * latents - noisy * told, signal * told + noisy * latents
    return (next_alpha**0.5 * picture + (1 - next_alpha) ** 0.5 * noise).astype(np.float32)
