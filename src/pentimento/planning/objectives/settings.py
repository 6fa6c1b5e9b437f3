"""Which objectives a plan is made for, with which weights, and what its first pass replicates."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.objectives.features import LocalFeatures
from pentimento.planning.objectives.print_objective import PrintObjective
from pentimento.planning.objectives.style import Features, StyleObjective
from pentimento.planning.objectives.vgg import load_vgg16
from pentimento.planning.objectives.weighted import Term, WeightedObjective
from pentimento.planning.target import fit_to_canvas, load_photograph


@dataclass(frozen=True)
class StyleConfig:
    """The style objective."""

    weight: float
    """Beside a print objective of weight 1, .02 is seen in a painting and .08 recolours it."""
    picture: str
    """A file, or the name of a photograph that scikit-image ships."""
    features: Literal["local", "vgg16"]
    vgg16_weights: str | None
    """File of torchvision's VGG-16 state dict, for ``features: vgg16``."""

    def __post_init__(self) -> None:
        above_zero(self, "weight")
        if (self.features == "vgg16") != (self.vgg16_weights is not None):
            raise ValueError(
                f"vgg16_weights is {self.vgg16_weights!r} while features is {self.features!r}; "
                "give the file with vgg16, and null otherwise."
            )


@dataclass(frozen=True)
class ObjectivesConfig:
    """The weighted sum that a plan is optimised for (thesis eq. 4.5)."""

    print_weight: float
    style: StyleConfig | None

    def __post_init__(self) -> None:
        at_least(self, 0, "print_weight")
        if self.print_weight == 0 and self.style is None:
            raise ValueError("print_weight is 0 and style is null; give at least one objective a weight.")


def load_style_picture(config: StyleConfig, shape: tuple[int, int]) -> Tensor:
    """The style picture's largest centred part of the canvas's proportions, linear light [H, W, 3] at ``shape``.

    Raises:
        ImageError: there is no such picture.
    """
    return torch.tensor(fit_to_canvas(load_photograph(config.picture), shape), dtype=torch.float32)


def style_features(config: StyleConfig) -> Features:
    """The network that the style objective looks through.

    Raises:
        ConfigError, ContractError: the file of weights is not there, or is none; see ``vgg.load_vgg16``.
    """
    match config.features:
        case "local":
            return LocalFeatures()
        case "vgg16":
            assert config.vgg16_weights is not None  # __post_init__ saw to it
            return load_vgg16(Path(config.vgg16_weights))


def build_objective(
    config: ObjectivesConfig, target: Tensor, style: Tensor | None, distances_px: tuple[int, ...], seed: int
) -> WeightedObjective:
    """The sum for a target and the style's picture (of ``load_style_picture``), both [H, W, 3] in linear light.

    Raises:
        ConfigError: a picture is too small for the print objective's distances or for local features.
        ValueError: the style objective has no picture.
    """
    terms: list[Term] = []
    if config.print_weight > 0:
        terms.append(Term("print", config.print_weight, PrintObjective(target, distances_px)))
    if config.style is not None:
        if style is None:
            raise ValueError("The style objective has no picture: load it by load_style_picture.")
        terms.append(Term("style", config.style.weight, StyleObjective(style, style_features(config.style), seed)))
    return WeightedObjective(tuple(terms))


def first_pass_target(config: ObjectivesConfig, target: Tensor, style: Tensor | None) -> Tensor:
    """What the first pass replicates, by the print objective alone, before the whole sum takes over (thesis 4.5.3).

    Style says what things are made of, not where they are. Where the print objective has no weight, nothing else
    composes the picture, so the plan starts as a copy of the style picture and is adapted from there; otherwise it
    starts as a copy of the target.
    """
    if config.print_weight == 0 and style is not None:
        return style
    return target
