"""What a goal is made of, as a person writes it: ``letter:A``, ``shape:pyramid``, or a file by its kind."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.images import read_image
from pentimento.goals3d.height_files import height_file_relief
from pentimento.goals3d.letters import letter_relief
from pentimento.goals3d.meshes import mesh_relief
from pentimento.goals3d.pictures import depth_relief, plain_relief
from pentimento.goals3d.placing import place, soften
from pentimento.goals3d.shapes import shape_relief
from pentimento.planning.pushes.goal import GoalError

FloatArray = NDArray[np.float64]

MESHES = (".stl", ".obj", ".ply")


def relief_of(
    source: str, shape: tuple[int, int], share: float, soften_px: float, depth_model: Path | None = None
) -> FloatArray:
    """The relief [H, W] of a source, placed in the middle of the area and as soft as tools can make it.

    Args:
        source: ``letter:<text>`` (sunken), ``shape:<name>``, or a file: .npy and 16-bit .png are heights, .stl, .obj
            and .ply meshes seen from +z, other pictures plain reliefs, or depth where there is a model.
        share: of the area's side.
        depth_model: folder of a depth model of transformers, or None.

    Raises:
        GoalError: no such letter, shape or file, or nothing in it to sculpt.
        ImageError: the picture is unreadable.
    """
    side_px = max(shape)
    kind, _, name = source.partition(":")
    if kind == "letter":
        relief = letter_relief(name, side_px)
    elif kind == "shape":
        relief = shape_relief(name, side_px)
    else:
        relief = _of_file(Path(source), side_px, depth_model)
    return soften(place(relief, shape, share), soften_px)


def _of_file(path: Path, side_px: int, depth_model: Path | None) -> FloatArray:
    if not path.is_file():
        raise GoalError(f"There is no goal {str(path)!r}: give letter:<text>, shape:<name>, or the path of a file.")
    suffix = path.suffix.lower()
    if suffix in MESHES:
        return mesh_relief(path, side_px)
    if suffix == ".npy" or (suffix == ".png" and _is_16_bit(path)):
        return height_file_relief(path)[0]
    picture = read_image(path)
    return plain_relief(picture) if depth_model is None else depth_relief(picture, depth_model)


def _is_16_bit(path: Path) -> bool:
    pixels = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    return pixels is not None and pixels.dtype == np.uint16
