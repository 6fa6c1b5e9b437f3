"""Goal pictures from a canvas and words: Instruct-Pix2Pix (Brooks et al. 2023), sampled by DDIM, in numpy.

The networks are plain callables, so this module depends on no runtime. The computation is that of diffusers'
``StableDiffusionInstructPix2PixPipeline`` with ``DDIMScheduler`` (Song et al. 2021, eq. 12) and σ = 0.
"""

from __future__ import annotations

import math
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

_BLOCK = 16  # numbers that PyTorch's generator draws at a time


@dataclass(frozen=True, eq=False)
class NoiseSchedule:
    """The picture's share of the noisy latents at each timestep, and what the network predicts."""

    alphas_cumprod: NDArray[np.float32]
    """[T]: share of the picture's variance, decreasing; the last is 0 with a zero terminal SNR (Lin et al. 2023)."""
    final_alpha: float
    """The share after the last step: 1, or the first of ``alphas_cumprod`` for networks published that way."""
    prediction: Prediction
    spacing: Spacing
    offset: int = 0
    """Added to each timestep where they are spaced from the front ("leading")."""

    def __post_init__(self) -> None:
        if self.prediction not in ("epsilon", "v_prediction", "sample") or self.spacing not in ("trailing", "leading"):
            raise ContractError(
                f"The noise schedule predicts {self.prediction!r} with {self.spacing!r} spacing; the sampler knows "
                "epsilon, v_prediction, sample and trailing, leading."
            )
        if self.prediction == "epsilon" and self.alphas_cumprod[-1] == 0:
            raise ContractError(
                "A schedule that ends in pure noise cannot use the prediction epsilon; use v_prediction or sample."
            )

    def timesteps(self, steps: int) -> NDArray[np.int64]:
        """Timesteps [steps] from noise to picture.

        Raises:
            ContractError: more steps than the schedule has.
        """
        count = len(self.alphas_cumprod)
        if not 1 <= steps <= count:
            raise ContractError(f"{steps} sampling steps are requested; the network allows 1 to {count}.")
        if self.spacing == "trailing":
            return np.round(np.arange(count, 0, -count / steps)).astype(np.int64) - 1
        leading = (np.arange(steps)[::-1] * (count // steps)).astype(np.int64) + self.offset
        if leading[0] >= count:
            raise ContractError(
                f"{steps} sampling steps are requested; with their offset of {self.offset} they would begin at "
                f"{leading[0]}, beyond the last timestep, {count - 1}. Take fewer."
            )
        return leading


@dataclass(frozen=True)
class Networks:
    """The goal planner's networks; pictures [B, 3, H, W] range from −1 to 1."""

    read: Callable[[NDArray[np.int64]], NDArray[np.float32]]
    """Tokens [B, L] to text states [B, L, D]."""
    encode: Callable[[FloatImage], Latents]
    """Pictures to latents [B, C, h, w]: the mode, not scaled, as in the training of Instruct-Pix2Pix."""
    predict: Callable[[Latents, int, NDArray[np.float32]], Latents]
    """Latents and those of the canvas [B, 2C, h, w], a timestep, text states [B, L, D] to a prediction [B, C, h, w]."""
    decode: Callable[[Latents], FloatImage]
    """Latents, divided by ``scaling``, to pictures."""
    scaling: float
    """Factor of the sampled latents."""


def complete(
    networks: Networks,
    schedule: NoiseSchedule,
    canvas: NDArray[np.uint8],
    *,
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
        image_guidance: s_I of Brooks et al., eq. 3; no effect where ``text_guidance`` is 1, as published.
        text_guidance: s_T; above 1, each step evaluates the network three times.
        progress: called with (steps done, steps) after each step.
    """
    guided = text_guidance > 1 and image_guidance >= 1
    condition = networks.encode(_as_input(canvas))
    text = networks.read(tokens)
    if guided:
        blank = np.repeat(networks.read(no_words), len(canvas), axis=0)
        text = np.concatenate([text, blank, blank])
        condition = np.concatenate([condition, condition, np.zeros_like(condition)])
    latents = noise.astype(np.float32)
    stride = len(schedule.alphas_cumprod) // steps
    for number, timestep in enumerate(schedule.timesteps(steps)):
        noisy = np.concatenate([np.concatenate([latents] * 3) if guided else latents, condition], axis=1)
        prediction = networks.predict(noisy, int(timestep), text)
        if guided:
            both, image_only, neither = np.split(prediction, 3)
            prediction = neither + text_guidance * (both - image_only) + image_guidance * (image_only - neither)
        latents = _step(schedule, prediction, int(timestep), int(timestep) - stride, latents)
        progress(number + 1, steps)
    return _as_uint8(networks.decode((latents / networks.scaling).astype(np.float32)))


def round_trip(networks: Networks, pictures: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pictures uint8 [B, H, W, 3], encoded and decoded by the autoencoder."""
    return _as_uint8(networks.decode(networks.encode(_as_input(pictures))))


def _as_input(pictures: NDArray[np.uint8]) -> FloatImage:
    """uint8 [B, H, W, 3] as [B, 3, H, W] from −1 to 1."""
    return (pictures.transpose(0, 3, 1, 2) / 127.5 - 1).astype(np.float32)


def _as_uint8(pictures: FloatImage) -> NDArray[np.uint8]:
    """[B, 3, H, W] from −1 to 1 as uint8 [B, H, W, 3]."""
    return np.round(np.clip(pictures / 2 + 0.5, 0, 1).transpose(0, 2, 3, 1) * 255).astype(np.uint8)


def _step(schedule: NoiseSchedule, prediction: Latents, now: int, then: int, latents: Latents) -> Latents:
    """Latents at timestep ``then`` from those at ``now`` (Song et al. 2021, eq. 12 with σ = 0)."""
    alpha = float(schedule.alphas_cumprod[now])
    next_alpha = float(schedule.alphas_cumprod[then]) if then >= 0 else schedule.final_alpha
    signal, noisy = alpha**0.5, (1 - alpha) ** 0.5
    match schedule.prediction:
        case "epsilon":
            picture, noise = (latents - noisy * prediction) / signal, prediction
        case "sample":
            picture, noise = prediction, (latents - signal * prediction) / noisy
        case "v_prediction":
            picture, noise = signal * latents - noisy * prediction, signal * prediction + noisy * latents
    return (next_alpha**0.5 * picture + (1 - next_alpha) ** 0.5 * noise).astype(np.float32)


def seed_for(*key: int) -> int:
    """The seed of a key such as (seed, number), as in ``copainting.jobs.generator_for``."""
    # numpy pads keys with zeros: without its length, (1, 0) would be (1,).
    state = np.random.SeedSequence((len(key), *key)).generate_state(2)
    return int(state[0]) << 31 ^ int(state[1])


def normal(shape: tuple[int, ...], seed: int) -> NDArray[np.float32]:
    """``torch.randn(shape, generator=torch.Generator().manual_seed(seed))`` up to rounding of float32.

    PyTorch's CPU generator in numpy, so that robot and workshop sample the same goal from the same seed: 24-bit uniform
    numbers of a Mersenne twister, in blocks of 16, through Box and Muller (1958). PyTorch uses another method for fewer
    than 16 numbers, which is not implemented.

    Raises:
        ContractError: fewer than 16 numbers.
    """
    count = math.prod(shape)
    if count < _BLOCK:
        raise ContractError(f"{count} random numbers are requested; at least {_BLOCK} agree with the workshop's.")
    twister = np.random.RandomState(seed & 0xFFFFFFFF)
    uniform = _uniform(twister, count)
    whole = count - count % _BLOCK
    numbers = np.empty(count, np.float32)
    numbers[:whole] = _box_muller(uniform[:whole])
    if whole < count:  # the last 16 numbers are drawn again
        numbers[-_BLOCK:] = _box_muller(_uniform(twister, _BLOCK))
    return numbers.reshape(shape)


def _uniform(twister: np.random.RandomState, count: int) -> NDArray[np.float32]:
    """[count] in [0, 1): the low 24 bits of each 32-bit number."""
    raw = twister.randint(0, 2**32, count, dtype=np.uint64) & 0xFFFFFF
    return (raw.astype(np.float64) / 2**24).astype(np.float32)


def _box_muller(uniform: NDArray[np.float32]) -> NDArray[np.float32]:
    """Normal numbers of blocks of 16: the first eight and the last eight of a block are paired."""
    pairs = uniform.reshape(-1, 2, _BLOCK // 2)
    radius = np.sqrt(-2 * np.log1p(-pairs[:, 0].astype(np.float64)))
    angle = 2 * np.pi * pairs[:, 1].astype(np.float64)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1).astype(np.float32).ravel()
