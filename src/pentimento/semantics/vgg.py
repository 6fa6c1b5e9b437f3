"""Local features by the published VGG-16 (Simonyan and Zisserman 2014), with weights from a local file.

The file is a state dict in torchvision's layout (`features.0.weight` ...), such as torchvision's `vgg16-397923af.pth`.
Nothing is downloaded, and no code in the file is executed.
"""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, max_pool2d

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.dynamics.strokes.photometry import linear_to_srgb
from pentimento.semantics.style_features import cell_grid, cell_means

BLOCKS: tuple[dict[int, tuple[int, int]], ...] = (
    {0: (3, 64), 2: (64, 64)},
    {5: (64, 128), 7: (128, 128)},
    {10: (128, 256), 12: (256, 256), 14: (256, 256)},
    {17: (256, 512), 19: (512, 512), 21: (512, 512)},
)
"""Convolutions by torchvision's index, with input and output channels. A ReLU follows each, a 2 x 2 maximum each block.

The last ReLU of each block is read, as in Johnson et al. 2016; the fifth block is not used.
"""
_MEAN, _SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of sRGB: how the network was trained
_EPSILON = 1e-6  # under the root of the squared norm: a gradient at zero activation


class Vgg16Features(nn.Module):
    """Pictures [H, W, 3] in linear light to sets [cells, 963] of local features; differentiable.

    The features of a cell of `style_features.CELL_PX` are its mean sRGB, and the mean activation of each block,
    normalised to length 1, so that distances compare directions (Kolkin et al. 2019) and blocks have equal weights.
    """

    mean: Tensor
    spread: Tensor

    def __init__(self, weights: dict[str, Tensor]) -> None:
        """For a checked state dict, see `load_vgg16`."""
        super().__init__()
        for name, tensor in weights.items():
            self.register_buffer(name.replace(".", "_"), tensor)
        self.register_buffer("mean", torch.tensor(_MEAN)[:, None, None])
        self.register_buffer("spread", torch.tensor(_SPREAD)[:, None, None])

    def forward(self, image: Tensor) -> Tensor:
        """The features of an image [H, W, 3].

        Raises:
            ConfigError: the image is smaller than a cell.
        """
        grid = cell_grid(image)
        srgb = linear_to_srgb(image.movedim(-1, 0))
        maps = [cell_means(srgb, grid)]
        activation = ((srgb - self.mean) / self.spread)[None]
        for block, convolutions in enumerate(BLOCKS):
            if block > 0:
                activation = max_pool2d(activation, 2)
            for index in convolutions:
                weight, bias = (self.get_buffer(f"features_{index}_{part}") for part in ("weight", "bias"))
                activation = conv2d(activation, weight, bias, padding=1).relu()
            means = cell_means(activation[0], grid)
            maps.append(means / (means.square().sum(0) + _EPSILON).sqrt())
        return torch.cat(maps).flatten(1).T


def load_vgg16(path: Path) -> Vgg16Features:
    """The features of a file of weights in torchvision's layout; other entries, such as the classifier's, are ignored.

    Raises:
        ConfigError: the file does not exist.
        ContractError: the file is no state dict, or lacks a tensor, or one has another shape or is not finite.
    """
    if not path.is_file():
        raise ConfigError(
            f"There are no VGG-16 weights at {path}: put torchvision's vgg16 state dict there, or choose the local "
            "features, which need no file."
        )
    try:
        state: Any = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, ValueError, EOFError, KeyError, pickle.UnpicklingError) as error:
        reason = str(error).partition("\n")[0]
        raise ContractError(f"{path} is not a file of tensors ({reason}): save a state dict by torch.save.") from error
    if not isinstance(state, dict):
        raise ContractError(f"{path} holds {type(state).__name__}, not a state dict: save model.state_dict().")
    return Vgg16Features({name: _checked(state, name, shape, path) for name, shape in _layout().items()})


def _layout() -> dict[str, tuple[int, ...]]:
    """Names and shapes of the tensors that are read."""
    layout: dict[str, tuple[int, ...]] = {}
    for convolutions in BLOCKS:
        for index, (channels_in, channels_out) in convolutions.items():
            layout[f"features.{index}.weight"] = (channels_out, channels_in, 3, 3)
            layout[f"features.{index}.bias"] = (channels_out,)
    return layout


def _checked(state: dict[Any, Any], name: str, shape: tuple[int, ...], path: Path) -> Tensor:
    tensor = state.get(name)
    if not isinstance(tensor, Tensor):
        raise ContractError(f"{path} has no tensor {name!r}: it is not a VGG-16 (without batch norm) of torchvision.")
    if tuple(tensor.shape) != shape:
        raise ContractError(f"{path}: {name} has shape {tuple(tensor.shape)}, VGG-16 has {shape}: take its weights.")
    if not bool(torch.isfinite(tensor).all()):
        raise ContractError(f"{path}: {name} is not finite: the file is damaged, take it again.")
    return tensor.float()
