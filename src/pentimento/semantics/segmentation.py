"""Regions of a picture: by Segment Anything if its weights are given, otherwise by a graph-based method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.semantics.devices import chosen_device, in_batches
from pentimento.semantics.pretrained import load_pretrained

_POINTS: Final = 64
"""Prompt points in one call; the masks of a call, three for each point, lie in memory as numbers."""


@dataclass(frozen=True)
class SegmentationConfig:
    """How a picture without a mask is segmented."""

    method: Literal["classical", "sam"]
    sam_folder: str | None
    """Local folder of a SAM model in the published layout (facebook/sam-vit-base), for `sam`."""
    scale: float
    """Of the classical method (Felzenszwalb and Huttenlocher 2004); larger values give larger regions."""
    min_share: float
    """Of the picture; smaller regions count as background."""
    points: int
    """Of SAM: prompt points along each side."""

    def __post_init__(self) -> None:
        above_zero(self, "scale")
        at_least(self, 0, "min_share")
        at_least(self, 1, "points")
        if (self.method == "sam") != (self.sam_folder is not None):
            raise ValueError(
                f"sam_folder is {self.sam_folder!r} while method is {self.method!r}; give the folder with sam, and "
                "null otherwise."
            )


def segment(image: NDArray[np.uint8], config: SegmentationConfig) -> NDArray[np.uint8]:
    """Labels [H, W] of an sRGB picture [H, W, 3]: 0 for the background, then regions from the largest on.

    The background is the region with the longest border of the picture, together with all regions that are too small.

    Raises:
        ConfigError: the folder holds no SAM model.
    """
    match config.method:
        case "classical":
            from skimage.segmentation import felzenszwalb

            labels = felzenszwalb(
                image,
                scale=config.scale,
                sigma=0.5,
                min_size=max(1, round(config.min_share * image.shape[0] * image.shape[1])),
            )
        case "sam":
            assert config.sam_folder is not None  # __post_init__ saw to it
            labels = _by_sam(image, Path(config.sam_folder), config.points)
    return _ordered(np.asarray(labels), config.min_share)


def _ordered(labels: NDArray[np.integer], min_share: float) -> NDArray[np.uint8]:
    """Labels sorted by size, at most 255; the background and regions that are too small become 0."""
    border = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    names, counts = np.unique(border, return_counts=True)
    ground = names[counts.argmax()]
    found, sizes = np.unique(labels, return_counts=True)
    order = np.lexsort((found, -sizes))
    kept = [found[i] for i in order if found[i] != ground and sizes[i] >= min_share * labels.size][:255]
    regions = np.zeros(labels.shape, np.uint8)
    for number, name in enumerate(kept, 1):
        regions[labels == name] = number
    return regions


@cache
def _load_sam(folder: Path) -> Any:
    from transformers import SamModel

    try:
        return load_pretrained(SamModel, folder, "The SAM model").to(chosen_device())
    except ConfigError as error:
        raise ConfigError(
            f"{folder} holds no SAM model ({error}); give a folder like facebook/sam-vit-base."
        ) from error


def _by_sam(image: NDArray[np.uint8], folder: Path, points: int) -> NDArray[np.int32]:
    """Labels of the masks at a grid of points, the one with the highest predicted IoU on top (Kirillov et al. 2023)."""
    model = _load_sam(folder)
    device = model.device
    side = int(model.config.vision_config.image_size)
    mean, spread = torch.tensor([123.675, 116.28, 103.53]), torch.tensor([58.395, 57.12, 57.375])  # as published
    pixels = ((torch.from_numpy(image.astype(np.float32)) - mean) / spread).permute(2, 0, 1)[None]
    height, width = image.shape[:2]
    grid = (torch.arange(points) + 0.5) / points * side
    places = torch.stack(torch.meshgrid(grid, grid, indexing="xy"), -1).reshape(1, -1, 1, 2)
    resized = torch.nn.functional.interpolate(pixels, (side, side), mode="bilinear", antialias=True)

    def masks_at(part: slice) -> tuple[NDArray[np.uint8], torch.Tensor, torch.Tensor]:
        """Packed masks [N, H · W / 8], their areas and their predicted IoU."""
        out = model(image_embeddings=seen, input_points=places[:, part].to(device), multimask_output=True)
        logits = torch.nn.functional.interpolate(
            out.pred_masks[0].flatten(0, 1)[None], (height, width), mode="bilinear"
        )
        masks = logits[0] > 0
        packed = np.packbits(masks.flatten(1).cpu().numpy(), axis=1)
        return packed, masks.float().mean((1, 2)).cpu(), out.iou_scores[0].flatten().cpu()

    with torch.no_grad():
        seen = model.get_image_embeddings(resized.to(device))
        packed, areas, ratings = zip(*in_batches(masks_at, points * points, _POINTS), strict=True)
    masks = np.concatenate(packed)
    labels = np.zeros(height * width, np.int32)
    # A mask of nearly everything is the ground, which stays 0.
    usable = (torch.cat(areas) < 0.9).tolist()
    for label, number in enumerate(torch.cat(ratings).argsort().tolist(), 1):
        if usable[number]:
            labels[np.unpackbits(masks[number], count=labels.size).astype(bool)] = label
    return labels.reshape(height, width)
