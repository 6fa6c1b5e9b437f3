"""Small goal planners of the published architecture at 16 x 16 px, and their training."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import torch

from pentimento.copainting.goal.denoising import GoalTraining, encode_pairs
from pentimento.copainting.goal.planner import GoalPlanner, GoalPlannerShape, build_goal_planner, text_encoder_of
from pentimento.copainting.goal.training import train_goal_planner
from pentimento.copainting.goal.vae import VaeConfig, build_vae
from pentimento.copainting.scenes.edits import Pair
from pentimento.semantics.encoder import Encoder, EncoderShape, new_model
from pentimento.semantics.tokenizer import learn_tokenizer

SIDE_PX = 16
CAPTIONS = ("a red disc", "a blue square", "a green disc on grey", "a yellow square")
VAE = VaeConfig(channels=(8, 8), latent_channels=4, pictures=8, steps=4, batch=2, learning_rate=1e-3)
SHAPE = GoalPlannerShape(unet_channels=(8, 16), unet_layers=1, heads=2, prediction="sample")
ENCODER = EncoderShape(
    image_px=16, patch_px=8, image_width=16, image_layers=1, text_width=16, text_layers=1, heads=2, embedding=8
)
TRAINING = GoalTraining(
    steps=6, batch=3, learning_rate=1e-3, warm_up=2, weight_decay=0.01, drop_text=0.05, drop_image=0.05,
    drop_both=0.05, min_snr_gamma=None, time_bias=1.0, ema_decay=0.9, lora=None, train_text=True, checkpoint_every=2,
    gradient_checkpointing=False, precision="32-true", accelerator="cpu", devices=1, strategy="auto", seed=3,
)  # fmt: skip


def small_encoder(text_width: int = 16) -> Encoder:
    """An untrained text-image encoder."""
    tokenizer = learn_tokenizer(CAPTIONS, 40, 12)
    return Encoder(new_model(replace(ENCODER, text_width=text_width), tokenizer, 0), tokenizer)


def small_planner(seed: int = 0, text_width: int = 16) -> GoalPlanner:
    """A new one; equal for equal seeds."""
    torch.manual_seed(seed)
    vae = build_vae(VAE, SIDE_PX).eval().requires_grad_(False)
    encoder = small_encoder(text_width)
    return build_goal_planner(SHAPE, vae, text_encoder_of(encoder.model), tokenizer=encoder.tokenizer, seed=seed)


def small_pairs(number: int, seed: int = 0) -> list[Pair]:
    """White paper and, as target, a dark bar on it."""
    pairs = []
    for index in range(number):
        generator = np.random.default_rng([seed, index])
        blank = np.full((SIDE_PX, SIDE_PX, 3), 240, np.uint8)
        full = blank.copy()
        row = int(generator.integers(2, SIDE_PX - 4))
        full[row : row + 3, 2:-2] = 30
        pairs.append(Pair(blank, full, CAPTIONS[index % len(CAPTIONS)]))
    return pairs


class _Killed(Exception):
    pass


@dataclass(frozen=True, eq=False)
class Trained:
    """A planner after training."""

    planner: GoalPlanner
    losses: list[float]
    """Empty if the training was killed."""
    steps: list[int]
    """The logged steps, in order."""

    @property
    def weights(self) -> torch.Tensor:
        """All trained weights in a row."""
        parts = (self.planner.unet, self.planner.text_encoder)
        return torch.cat([weight.detach().flatten() for part in parts for weight in part.state_dict().values()])


def trained(config: GoalTraining, scratch: Path | None = None, until: int | None = None) -> Trained:
    """A small planner after training, or killed at step `until`."""
    result = Trained(small_planner(), [], [])

    def log(_name: str, _value: float, step: int) -> None:
        result.steps.append(step)
        if step == until:
            raise _Killed

    pairs = encode_pairs(result.planner, small_pairs(7))
    try:
        result.losses.extend(train_goal_planner(result.planner, pairs, config, scratch=scratch, log=log))
    except _Killed:
        assert until is not None
    return result


@cache
def uninterrupted(config: GoalTraining) -> Trained:
    """The result of a training in this process, computed once."""
    return trained(config)
