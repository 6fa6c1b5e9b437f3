"""The style that a planner's settings ask for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.planning.strokes.config import PlannerConfig, StyleConfig
from pentimento.planning.strokes.target import fit_to_canvas, load_photograph
from pentimento.semantics.style.features import LocalFeatures
from pentimento.semantics.style.style import Features, StyleObjective
from pentimento.semantics.style.torch_objective import TorchObjective
from pentimento.semantics.style.vgg import load_vgg16

Array = NDArray[np.float32]


def style_of(config: PlannerConfig) -> PictureStyle | None:
    """The style of a planner's objectives, where they have one: what ``Scene.style`` wants."""
    style = config.objectives.style
    return None if style is None else PictureStyle(style, config.seed)


class PictureStyle:
    """A picture's style, a ``planning.strokes.scene.Style``."""

    def __init__(self, config: StyleConfig, seed: int) -> None:
        """``seed`` is of the draws where a picture has too many cells to pair them all."""
        self._config, self._seed = config, seed

    def picture(self, shape: tuple[int, int]) -> Array:
        """The picture's largest centred part of the canvas's proportions, linear light [H, W, 3] at ``shape``.

        Raises:
            ImageError: there is no such picture.
        """
        return fit_to_canvas(load_photograph(self._config.picture), shape).astype(np.float32)

    def objective(self, shape: tuple[int, int]) -> TorchObjective:
        """The style objective for images of this height and width.

        Raises:
            ConfigError, ContractError, ImageError: the picture or the file of weights is not there or is none, or the
                picture is too small for local features.
        """
        style = torch.from_numpy(self.picture(shape))
        return TorchObjective(StyleObjective(style, style_features(self._config), self._seed))


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
