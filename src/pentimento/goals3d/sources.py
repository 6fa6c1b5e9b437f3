"""Relief of a goal as written in a configuration: ``letter:A``, ``shape:pyramid``, or a file (heights, mesh,
picture)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from tokenize import TokenError
from typing import Literal

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError, ImageError
from pentimento.contracts.images import read_image
from pentimento.contracts.picture_files import decode_deep
from pentimento.goals3d.obj_file import read_obj
from pentimento.goals3d.ply_file import read_ply
from pentimento.goals3d.reliefs import letter_relief, place, shape_relief, soften
from pentimento.planning.pushes.goal import GoalError
from pentimento.planning.pushes.holes import fill_holes
from pentimento.planning.strokes.target import averaged_light

FloatArray = NDArray[np.float64]
Up = Literal["x", "y", "z"]
MESHES = (".stl", ".obj", ".ply")
"""Suffixes of mesh files."""
HEIGHTS = (".png", ".tif", ".tiff")
"""Suffixes of pictures that hold heights where they are grey with 16 or more bits."""
_MAX_HOLES = 0.5
"""Maximum share of holes in a height map."""
_MIN_PROPORTION = 1e-3
"""Minimum ratio of a mesh's sides, seen from above."""
Image = NDArray[np.uint8]
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear red, green, blue (Rec. 709)."""
_BLUR = 0.01
"""Standard deviation of the blur of a picture, as a fraction of its longer side."""
_PLAIN_PX = 1024
"""Longer side of the plain relief of a picture, at most."""


def relief_of(
    source: str,
    shape: tuple[int, int],
    share: float,
    *,
    soften_px: float,
    depth_model: Path | None = None,
    up: Up | None = None,
    tell: Callable[[str], None] | None = None,
) -> FloatArray:
    """Relief [H, W] of a source, centred in the area and blurred to what tools can form.

    Args:
        source: ``letter:<text>`` (sunken), ``shape:<name>``, ``heights:<grey picture of 8 bits>``, or a file: .npy,
            16-bit grey .png and .tif hold heights, .stl, .obj and .ply meshes seen from above; any other picture
            becomes a plain relief, or its depth if a depth model is given.
        shape: of the area, [H, W] pixels.
        share: of the area's side that the relief covers.
        depth_model: folder of a depth model of transformers, or None.
        up: axis of a mesh that points up; by default z, but an OBJ needs it.
        tell: is given a sentence where holes were filled; by default it is printed on stderr.

    Raises:
        GoalError: there is no such letter, shape or file, or it holds nothing to sculpt.
        ImageError: the picture is unreadable.
    """
    side_px = max(shape)
    kind, _, name = source.partition(":")
    if kind == "letter":
        relief = letter_relief(name, side_px)
    elif kind == "shape":
        relief = shape_relief(name, side_px)
    elif kind == "heights":
        relief = _grey_relief(_existing(name))
    else:
        relief = _file_relief(_existing(source), side_px, depth_model, up=up, tell=tell)
    return soften(place(relief, shape, share), soften_px)


def _existing(name: str) -> Path:
    if not Path(name).is_file():
        raise GoalError(f"There is no goal {name!r}: give letter:<text>, shape:<name>, or the path of a file.")
    return Path(name)


def _file_relief(
    path: Path, side_px: int, depth_model: Path | None, *, up: Up | None, tell: Callable[[str], None] | None
) -> FloatArray:
    suffix = path.suffix.lower()
    if suffix in MESHES:
        if suffix == ".obj" and up is None:
            raise GoalError(
                f"{path}: an OBJ does not say which of its axes points up; give `up`: y as most programs export it, or "
                "x or z."
            )
        return mesh_relief(path, side_px, up or "z")
    if suffix == ".npy" or (suffix in HEIGHTS and decode_deep(path.read_bytes(), str(path)) is not None):
        relief, holes = height_file_relief(path)
        if holes:
            sentence = f"{path}: {holes} of {relief.size} heights were not measured; they were filled from neighbours."
            print(sentence, file=sys.stderr) if tell is None else tell(sentence)
        return relief
    picture = read_image(path)
    return plain_relief(picture) if depth_model is None else depth_relief(picture, depth_model)


def _grey_relief(path: Path) -> FloatArray:
    picture = read_image(path)
    if (picture != picture[..., :1]).any():
        raise GoalError(f"{path} is in colour; heights are grey. Give it without heights: to sculpt the picture.")
    return picture[..., 0].astype(np.float64)


def height_file_relief(path: Path) -> tuple[FloatArray, int]:
    """Heights [h, w] of a ``.npy`` or a deep grey ``.png`` or ``.tif``, and the number of holes that were filled.

    A hole is NaN. 0 is a height: in a goal, black is the ground.

    Raises:
        GoalError: unreadable, not a map of real numbers, more than half holes, or infinite heights.
    """
    try:
        if path.suffix.lower() == ".npy":
            heights = np.load(path, allow_pickle=False)
            if not isinstance(heights, np.ndarray):
                raise ValueError("it is an archive of arrays, .npz")
        else:
            heights = decode_deep(path.read_bytes(), "It")
            if heights is None:
                raise ImageError("it has 8 bits a pixel or colour")
    except (OSError, ValueError, EOFError, SyntaxError, TokenError, MemoryError, ImageError, ContractError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise GoalError(f"{path} cannot be read as a height map ({reason}); save it as 16-bit PNG or .npy.") from error
    if heights.ndim != 2 or heights.dtype.kind not in "fiu" or min(heights.shape) < 2:
        raise GoalError(f"{path} holds {heights.dtype}{list(heights.shape)}; a height map is real numbers [h, w].")
    heights = heights.astype(np.float64)
    holes = int(np.isnan(heights).sum())
    if holes > _MAX_HOLES * heights.size:
        raise GoalError(
            f"{path}: {holes} of {heights.size} pixels are holes; a goal needs at least half of them measured."
        )
    try:
        return fill_holes(heights)
    except ContractError as error:
        raise GoalError(f"{path}: {error}") from None


def mesh_relief(path: Path, side_px: int, up: Up = "z") -> FloatArray:
    """Highest point of a mesh in each pixel [h, w], with a longer side of ``side_px``; the lowest where there is none.

    Args:
        up: axis of the file that points up. Right and up in the picture are x and y for z, x and -z for y, y and z
            for x.

    Raises:
        GoalError: unreadable, without faces, with non-finite vertices, or without an extent from above.
    """
    vertices, faces = _mesh(path)
    if faces.size == 0:
        raise GoalError(
            f"{path} has no faces; a mesh to sculpt needs triangles (a point cloud is another kind of file)."
        )
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.max() >= len(vertices) or faces.min() < 0:
        raise GoalError(f"{path} has vertices without three coordinates, or faces without vertices; repair the mesh.")
    if not np.isfinite(vertices[faces]).all():
        raise GoalError(f"{path} has vertices that are not finite numbers; repair the mesh.")
    axes, signs = {"z": ([0, 1, 2], [1, 1, 1]), "y": ([0, 2, 1], [1, -1, 1]), "x": ([1, 2, 0], [1, 1, 1])}[up]
    return top_of((vertices[:, axes] * signs)[faces], side_px)


def _mesh(path: Path) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices [V, 3] and triangles [T, 3] of a file."""
    import trimesh

    try:
        if path.suffix.lower() == ".obj":
            return read_obj(path)
        if path.suffix.lower() == ".ply":
            return read_ply(path)
        with np.errstate(invalid="ignore"):  # vertices that are no numbers are refused by the caller
            mesh = trimesh.load_mesh(path)
            vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except (OSError, ValueError, LookupError, ArithmeticError, AttributeError, TypeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise GoalError(f"{path} cannot be read as a mesh ({reason}); export it again as STL, OBJ or PLY.") from error
    return vertices, faces


def top_of(triangles: FloatArray, side_px: int) -> FloatArray:
    """Orthographic z-buffer [h, w] of triangles [T, 3, 3] (x right, y up, z towards the eye).

    Raises:
        GoalError: seen from above, the triangles are a line or a point.
    """
    low, high = triangles[..., :2].min(axis=(0, 1)), triangles[..., :2].max(axis=(0, 1))
    extent = high - low
    if not extent.min() > _MIN_PROPORTION * extent.max():
        raise GoalError(
            f"Seen from above, the mesh measures {extent[0]:g} by {extent[1]:g}; turn it so that it shows a face."
        )
    k = side_px / extent.max()
    width, height = (max(round(side), 2) for side in k * extent)
    pixels = triangles.copy()
    pixels[..., 0] = (triangles[..., 0] - low[0]) * k - 0.5
    pixels[..., 1] = (high[1] - triangles[..., 1]) * k - 0.5
    top = np.full((height, width), -np.inf)
    _rasterise(pixels, top)
    return np.where(np.isfinite(top), top, triangles[..., 2].min())


@numba.njit(cache=True)
def _rasterise(triangles, top):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Raise each pixel of ``top`` to the triangles [T, 3, 3] (column, row, z) that cover its centre."""
    height, width = top.shape
    for t in range(len(triangles)):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:  # depth_map edge-on
            continue
        for row in range(max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), height - 1) + 1):
            first, last = max(int(np.ceil(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))), width - 1)
            for column in range(first, last + 1):
                b = ((column - ax) * (cy - ay) - (row - ay) * (cx - ax)) / area
                c = ((bx - ax) * (row - ay) - (by - ay) * (column - ax)) / area
                if b >= -1e-9 and c >= -1e-9 and b + c <= 1 + 1e-9:
                    top[row, column] = max(top[row, column], az + b * (bz - az) + c * (cz - az))


def plain_relief(picture: Image) -> FloatArray:
    """Bright is high: lightness [h, w] of a picture, sRGB [H, W, 3], blurred by a hundredth of its longer side.

    A picture of more than 1024 pixels on its longer side is averaged down to that.
    """
    scale = min(1.0, _PLAIN_PX / max(picture.shape))
    height, width = (max(round(scale * side), 1) for side in picture.shape[:2])
    luminance = averaged_light(picture, (height, width)) @ _LUMINANCE
    smooth = cv2.GaussianBlur(luminance, (0, 0), max(_BLUR * max(luminance.shape), 0.5))
    return np.asarray(np.cbrt(np.clip(smooth, 0.0, 1.0)))  # approximates CIE L*


def depth_relief(picture: Image, folder: Path) -> FloatArray:
    """Near is high: depth [h, w] of a picture, sRGB [h, w, 3], by a depth model of transformers in a local folder.

    Models of relative depth predict inverse depth, models of metric depth metres; both are converted to heights.

    Raises:
        GoalError: the folder holds no such model, or its depth is constant or not finite.
    """
    import torch
    from transformers import AutoImageProcessor, AutoModelForDepthEstimation

    from pentimento.semantics.pretrained import load_pretrained, unreadable

    try:
        model = load_pretrained(AutoModelForDepthEstimation, folder, "The depth model")
        with unreadable(f"The image processor in {folder}"):
            processor = AutoImageProcessor.from_pretrained(folder, local_files_only=True)
    except ConfigError as error:
        raise GoalError(
            f"{folder} holds no depth model of transformers ({error}); save model and image processor there with "
            "save_pretrained, or choose the plain relief."
        ) from error
    with torch.no_grad():
        depth_map = model(**processor(images=picture, return_tensors="pt")).predicted_depth[0].double().numpy()
    if not np.isfinite(depth_map).all() or np.ptp(depth_map) == 0:
        raise GoalError(f"The depth model of {folder} sees no depth in this picture; choose the plain relief.")
    metric = getattr(model.config, "depth_estimation_type", "relative") == "metric"
    depth = cv2.resize(depth_map, (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(-depth if metric else depth, dtype=np.float64)
