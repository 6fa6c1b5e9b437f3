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

from pentimento.contracts.errors import ContractError, ImageError
from pentimento.contracts.images import read_image
from pentimento.contracts.picture_files import decode_deep
from pentimento.goals3d.mesh_files import MESHES, read_mesh
from pentimento.goals3d.reliefs import letter_relief, place, shape_relief, soften
from pentimento.planning.pushes.goal import GoalError
from pentimento.planning.pushes.holes import fill_holes
from pentimento.planning.strokes.target import averaged_light

FloatArray = NDArray[np.float64]
Up = Literal["x", "y", "z"]
HEIGHTS = (".png", ".tif", ".tiff")
"""Suffixes of pictures that hold heights where they are grey with 16 or more bits."""
_MAX_HOLES = 0.5
"""Maximum share of holes in a height map."""
_FLATTER = 2.0
"""A mesh that is this many times as large along its up axis as across may lie on its side."""
_OPEN = 0.01
"""Share of the area that faces up or down in total; less is taken as a closed surface."""
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
    depth: Callable[[Image], FloatArray] | None = None,
    up: Up | None = None,
    font: Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> FloatArray:
    """Relief [H, W] of a source, centred in the area and blurred to what tools can form.

    Args:
        source: ``letter:<text>`` (sunken), ``shape:<name>``, ``heights:<grey picture of 8 bits>``, or a file: .npy,
            16-bit grey .png and .tif hold heights, .stl, .obj and .ply meshes seen from above; any other picture
            becomes a plain relief, or its depth where that is given.
        shape: of the area, [H, W] pixels.
        share: of the area's side that the relief covers.
        depth: the heights [h, w] of a picture, such as ``semantics.depth.depth_relief``; None for a plain relief.
        up: axis of a mesh that points up; by default z, but an OBJ needs it.
        font: file of the letters' font; by default the first installed one that has them.
        tell: is given a sentence where something was repaired; by default it is printed on stderr.

    Raises:
        GoalError: there is no such letter, shape or file, or it holds nothing to sculpt.
        ImageError: the picture is unreadable.
    """
    side_px = max(shape)
    kind, _, name = source.partition(":")
    if kind == "letter":
        relief = letter_relief(name, side_px, font)
    elif kind == "shape":
        relief = shape_relief(name, side_px)
    elif kind == "heights":
        relief = _grey_relief(_existing(name))
    else:
        relief = _file_relief(_existing(source), side_px, depth, up=up, tell=tell)
    return soften(place(relief, shape, share), soften_px)


def height_source(path: Path, tell: Callable[[str], None]) -> str:
    """The source for ``relief_of`` of a file that holds heights, of 8 bits as well.

    Raises:
        GoalError: there is no such file, or it is of another kind.
    """
    _existing(str(path))
    suffix = path.suffix.lower()
    if suffix in MESHES:
        raise GoalError(f"{path} is a mesh; give it with --goal-mesh.")
    if suffix == ".npy" or (suffix in HEIGHTS and decode_deep(path.read_bytes(), str(path)) is not None):
        return str(path)
    tell(f"{path} has 8 bits: its heights are in 256 steps. Save heights with 16 bits, or as .npy.")
    return f"heights:{path}"


def print_to_stderr(sentence: str) -> None:
    """For what a caller of this module does not ask to be told otherwise."""
    print(sentence, file=sys.stderr)


def _existing(name: str) -> Path:
    if not Path(name).is_file():
        raise GoalError(f"There is no goal {name!r}: give letter:<text>, shape:<name>, or the path of a file.")
    return Path(name)


def _file_relief(
    path: Path,
    side_px: int,
    depth: Callable[[Image], FloatArray] | None,
    *,
    up: Up | None,
    tell: Callable[[str], None] | None,
) -> FloatArray:
    suffix = path.suffix.lower()
    if suffix in MESHES:
        if suffix == ".obj" and up is None:
            raise GoalError(
                f"{path}: an OBJ does not say which of its axes points up; give `up`: y as most programs export it, or "
                "x or z."
            )
        return mesh_relief(path, side_px, up, tell=tell)
    if suffix == ".npy" or (suffix in HEIGHTS and decode_deep(path.read_bytes(), str(path)) is not None):
        relief, holes = height_file_relief(path)
        if holes:
            sentence = f"{path}: {holes} of {relief.size} heights were not measured; they were filled from neighbours."
            (print_to_stderr if tell is None else tell)(sentence)
        return relief
    picture = read_image(path)
    return plain_relief(picture) if depth is None else depth(picture)


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


def mesh_relief(
    path: Path, side_px: int, up: Up | None = None, *, tell: Callable[[str], None] | None = None
) -> FloatArray:
    """Highest point of a mesh in each pixel [h, w], with a longer side of ``side_px``; the lowest where there is none.

    Args:
        up: axis of the file that points up, by default z. Right and up in the picture are x and y for z, x and -z for
            y, y and z for x. The unit is of no importance.
        tell: is given a sentence where the mesh is inside out or seems to lie on its side.

    Raises:
        GoalError: unreadable, too large, without faces, with non-finite vertices, or without an extent from above.
    """
    vertices, faces = read_mesh(path)
    used = vertices[faces]
    if not np.isfinite(used).all():
        raise GoalError(f"{path} has vertices that are not finite numbers; repair the mesh.")
    axes, signs = {"z": ([0, 1, 2], [1, 1, 1]), "y": ([0, 2, 1], [1, -1, 1]), "x": ([1, 2, 0], [1, 1, 1])}[up or "z"]
    triangles = used[:, :, axes] * signs
    relief = top_of(triangles, side_px)
    tell = print_to_stderr if tell is None else tell
    if _inside_out(triangles):
        tell(f"{path}: its faces point inwards (they are inverted); they are taken as seen from above all the same.")
    extent = np.ptp(triangles.reshape(-1, 3), axis=0)
    if up is None and extent[2] > _FLATTER * extent[1]:
        tell(
            f"{path}: z is taken as up, and the mesh is {extent[2] / extent[1]:.1f} times as high as deep; if "
            "it lies on its back, give y as the axis that points up (--up y)."
        )
    return relief


def _inside_out(triangles: FloatArray) -> bool:
    """Whether most faces of triangles [T, 3, 3] point down, or, where as many point up, inwards."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    upwards, area = float(normal[:, 2].sum()), float(np.linalg.norm(normal, axis=1).sum())
    if abs(upwards) > _OPEN * area:
        return upwards < 0
    middle = triangles.reshape(-1, 3).mean(axis=0)
    return float((normal * (a - middle)).sum()) < 0


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
