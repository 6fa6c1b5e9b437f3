"""Relief of a goal as written in a configuration: ``letter:A``, ``shape:pyramid``, or a file (heights, mesh,
picture)."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError
from typing import Literal

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.colour import srgb_to_linear, to_float
from pentimento.contracts.errors import ContractError, ImageError
from pentimento.contracts.height_maps import decode_height_m
from pentimento.contracts.images import read_image
from pentimento.goals3d.reliefs import letter_relief, place, shape_relief, soften
from pentimento.planning.pushes.goal import GoalError
from pentimento.planning.pushes.holes import fill_holes

FloatArray = NDArray[np.float64]
MESHES = (".stl", ".obj", ".ply")
"""Suffixes of mesh files."""
_MAX_HOLES = 0.5
"""Maximum share of holes in a height map."""
_MIN_PROPORTION = 1e-3
"""Minimum ratio of a mesh's sides, seen from above."""
Image = NDArray[np.uint8]
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear red, green, blue (Rec. 709)."""
_BLUR = 0.01
"""Standard deviation of the blur of a picture, as a fraction of its longer side."""


def relief_of(
    source: str, shape: tuple[int, int], share: float, *, soften_px: float, depth_model: Path | None = None
) -> FloatArray:
    """Relief [H, W] of a source, centred in the area and blurred to what tools can form.

    Args:
        source: ``letter:<text>`` (sunken), ``shape:<name>``, or a file: .npy and 16-bit .png hold heights, .stl, .obj
            and .ply meshes seen from +z; any other picture becomes a plain relief, or its depth if a depth model is
            given.
        shape: of the area, [H, W] pixels.
        share: of the area's side that the relief covers.
        depth_model: folder of a depth model of transformers, or None.

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
    else:
        relief = _file_relief(Path(source), side_px, depth_model)
    return soften(place(relief, shape, share), soften_px)


def _file_relief(path: Path, side_px: int, depth_model: Path | None) -> FloatArray:
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


def height_file_relief(path: Path) -> tuple[FloatArray, int]:
    """Heights [h, w] of a ``.png`` (16 bit, 0 = hole) or ``.npy`` file, and the number of holes that were filled.

    Raises:
        GoalError: unreadable, not a map of real numbers, more than half holes, or infinite heights.
    """
    try:
        if path.suffix.lower() == ".npy":
            heights = np.load(path, allow_pickle=False)
        else:
            heights = decode_height_m(path.read_bytes(), 1.0)
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


def mesh_relief(path: Path, side_px: int, up: Literal["x", "y", "z"] = "z") -> FloatArray:
    """Highest point of a mesh in each pixel [h, w], with a longer side of ``side_px``; the lowest where there is none.

    Args:
        up: axis of the file that points up; the other two point right and up in the picture, in cyclic order.

    Raises:
        GoalError: unreadable, without faces, with non-finite vertices, or without an extent from above.
    """
    import trimesh

    try:
        mesh = trimesh.load_mesh(path)
    except (OSError, ValueError, LookupError, ArithmeticError, AttributeError, TypeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise GoalError(f"{path} cannot be read as a mesh ({reason}); export it again as STL, OBJ or PLY.") from error
    faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, dtype=np.float64)
    if faces.size == 0:
        raise GoalError(
            f"{path} has no faces; a mesh to sculpt needs triangles (a point cloud is another kind of file)."
        )
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.max() >= len(vertices):
        raise GoalError(f"{path} has vertices without three coordinates, or faces without vertices; repair the mesh.")
    if not np.isfinite(vertices).all():
        raise GoalError(f"{path} has vertices that are not finite numbers; repair the mesh.")
    axis = "xyz".index(up)
    return top_of(vertices[:, [(axis + 1) % 3, (axis + 2) % 3, axis]][faces], side_px)


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
    """Bright is high: lightness [h, w] of a picture, sRGB [h, w, 3], blurred by a hundredth of its longer side."""
    luminance = srgb_to_linear(to_float(picture).astype(np.float64)) @ _LUMINANCE
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

    try:
        processor = AutoImageProcessor.from_pretrained(folder, local_files_only=True)
        model = AutoModelForDepthEstimation.from_pretrained(folder, local_files_only=True).eval()
    except (OSError, ValueError, KeyError) as error:
        first = str(error).splitlines()[0]
        raise GoalError(
            f"{folder} holds no depth model of transformers ({first}); save model and image processor there with "
            "save_pretrained, or choose the plain relief."
        ) from error
    with torch.no_grad():
        depth_map = model(**processor(images=picture, return_tensors="pt")).predicted_depth[0].double().numpy()
    if not np.isfinite(depth_map).all() or np.ptp(depth_map) == 0:
        raise GoalError(f"The depth model of {folder} sees no depth in this picture; choose the plain relief.")
    metric = getattr(model.config, "depth_estimation_type", "relative") == "metric"
    depth = cv2.resize(depth_map, (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(-depth if metric else depth, dtype=np.float64)
