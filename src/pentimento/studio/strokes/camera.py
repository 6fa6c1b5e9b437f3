"""The camera over the table: perspective, lens, uneven light, a sensor with noise, and eight bits of sRGB."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from pentimento.contracts.colour import linear_to_srgb, to_uint8
from pentimento.contracts.markers import DICTIONARY, MarkerLayout
from pentimento.studio.strokes.sheet import CELLS_PER_M
from pentimento.studio.strokes.world import Camera, Effects

LEVELS = 4096  # of the table from linear light to sRGB bytes

Field = NDArray[np.float32]
Plane = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Optics:
    """What is constant between photos.

    column, row: float32[h,w], the place on the scene that each pixel of the frame sees; light: float32[h,w,3]
    exposure, white balance, vignetting and uneven light together; blur_px: optical blur in the frame.
    """

    column: Field
    row: Field
    light: Field
    blur_px: float


def table_scene(
    canvas_size_m: tuple[float, float], layout: MarkerLayout, margin_m: float, rng: np.random.Generator
) -> tuple[Field, tuple[int, int]]:
    """Table with printed markers, float32[H,W,3] linear light, and the (row, column) of the sheet's first cell."""
    margin = round(margin_m * CELLS_PER_M)
    rows, columns = (round(s * CELLS_PER_M) + 2 * margin for s in reversed(canvas_size_m))
    noise = rng.standard_normal((rows, columns // 30 + 2), dtype=np.float32)
    fibres = cv2.resize(cv2.GaussianBlur(noise, (0, 0), 1.0), (columns, rows), interpolation=cv2.INTER_CUBIC)
    wood = np.array([0.36, 0.33, 0.30], dtype=np.float32)
    scene = wood * (1 + np.float32(0.05 / fibres.std()) * fibres)[..., None]
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    side = round(layout.side_m * CELLS_PER_M)
    quiet = round(0.19 * side)  # white round the black square; ArUco needs one module, a sixth of the side
    for marker, (x_m, y_m) in zip(layout.ids, layout.centres_m, strict=True):
        c = round(x_m * CELLS_PER_M - side / 2) + margin
        r = rows - margin - round(y_m * CELLS_PER_M + side / 2)
        scene[max(r - quiet, 0) : r + side + quiet, max(c - quiet, 0) : c + side + quiet] = 0.82
        ink = cv2.aruco.generateImageMarker(dictionary, marker, side)
        scene[r : r + side, c : c + side] = np.where(ink[..., None] > 0, 0.82, 0.03)
    return scene, (margin, margin)


def make_optics(camera: Camera, effects: Effects, canvas_size_m: tuple[float, float]) -> Optics:
    """For each pixel, the place on the scene that it sees and the light that it gets."""
    size_m = np.asarray(canvas_size_m) + 2 * camera.margin_m
    width, height = (int(np.ceil(s * camera.pixels_per_m)) for s in size_m)
    half = 0.5 * math.hypot(width, height)
    x = ((np.arange(width, dtype=np.float32) - (width - 1) / 2) / half)[None, :]
    y = ((np.arange(height, dtype=np.float32) - (height - 1) / 2) / half)[:, None]
    u, v = _through_lens(x, y, camera, effects.lens_distortion)
    u, v = _onto_table(u, v, camera)
    metres = half / camera.pixels_per_m
    column = (u * metres + size_m[0] / 2) * CELLS_PER_M - 0.5
    row = (v * metres + size_m[1] / 2) * CELLS_PER_M - 0.5
    light = _light(x, y, camera, effects)[..., None] * np.asarray(camera.white_balance, dtype=np.float32)
    light = light * (camera.exposure_s / 0.008 * camera.gain)
    return Optics(
        column.astype(np.float32),
        row.astype(np.float32),
        light.astype(np.float32),
        camera.blur_m * camera.pixels_per_m,
    )


def _through_lens(x: Plane, y: Plane, camera: Camera, strength: float) -> tuple[Plane, Plane]:
    """Directions without a lens, from places in the frame; radius 1 is the frame's corner."""
    dx, dy = x - camera.decentring, y + 0.6 * camera.decentring
    r2 = dx**2 + dy**2
    k1, k2, k3 = camera.radial
    factor = strength * (k1 * r2 + k2 * r2**2 + k3 * r2**3)
    return x + dx * factor, y + dy * factor


def _onto_table(u: Plane, v: Plane, camera: Camera) -> tuple[Plane, Plane]:
    """Rotation and perspective of a camera at the table's front edge."""
    c, s = math.cos(camera.rotation_rad), math.sin(camera.rotation_rad)
    u, v = c * u - s * v, s * u + c * v
    depth = 1 + camera.keystone * (v + 0.3 * u)
    return u / depth, v / depth


def _light(x: Plane, y: Plane, camera: Camera, effects: Effects) -> Plane:
    # cos^4 law for the natural fall-off of a lens
    tangent2 = (x**2 + y**2) * math.tan(camera.field_angle_rad) ** 2
    fall_off = 1 + effects.vignetting * ((1 + tangent2) ** -2 - 1)
    # A lamp at one side: stronger near it, by the inverse square law rather than linearly.
    nearer = camera.gradient[0] * x - camera.gradient[1] * y
    lamp = 1 + effects.illumination_gradient * ((1 - nearer / 2) ** -2 - 1)
    return np.asarray(fall_off * lamp)


def expose(scene: Field, optics: Optics, camera: Camera, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Take a photo of a scene float32[H,W,3] linear light: uint8[h,w,3] sRGB."""
    image = cv2.remap(scene, optics.column, optics.row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    if optics.blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), optics.blur_px)
    chance = np.frombuffer(rng.bytes(2 * image.size), dtype=np.uint16).reshape(image.shape)
    frame = np.empty(image.shape, dtype=np.uint8)
    shot = camera.gain / camera.full_well
    _digitise(image, optics.light, chance, shot, camera.read_noise, _NORMAL, _SRGB_BYTES, frame)
    return frame


@njit(cache=True, error_model="numpy")
def _digitise(
    image: Field,
    light: Field,
    chance: NDArray[np.uint16],
    shot: float,
    read: float,
    normal: Field,
    srgb: NDArray[np.uint8],
    out: NDArray[np.uint8],
) -> None:
    """Shot noise, which grows with the signal, and read noise; then 8-bit sRGB. `normal` holds normal quantiles."""
    top, shot32, read2 = np.float32(srgb.size - 1), np.float32(shot), np.float32(read * read)
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            for i in range(3):
                signal = max(image[r, c, i] * light[r, c, i], np.float32(0))
                signal += np.sqrt(shot32 * signal + read2) * normal[chance[r, c, i] >> 4]
                level = min(max(signal, np.float32(0)), np.float32(1)) * top
                out[r, c, i] = srgb[int(level + np.float32(0.5))]


def _normal_quantiles() -> Field:
    """Normal quantiles at the middles of 4096 equal probabilities."""
    deviates = np.linspace(-4.5, 4.5, 20001)
    density = np.exp(-0.5 * deviates**2)
    distribution = np.cumsum(density) - 0.5 * density
    return np.interp((np.arange(4096) + 0.5) / 4096, distribution / density.sum(), deviates).astype(np.float32)


_NORMAL = _normal_quantiles()
_SRGB_BYTES = to_uint8(linear_to_srgb(np.linspace(0.0, 1.0, LEVELS)))
