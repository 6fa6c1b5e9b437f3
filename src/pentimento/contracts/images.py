"""PNG in and out, and picture files in. RGB order everywhere; OpenCV's BGR never leaves this module."""

import math
import re
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ImageError, PentimentoError
from pentimento.contracts.frames import pixels_per_m
from pentimento.contracts.picture_files import MAX_PIXELS, PNG, decode_picture

_SAYS_MORE: Final = re.compile(rb"iCCP|eXIf|cICP|gAMA|cHRM")
"""A PNG's chunks of colour and orientation."""


def encode_png(image: npt.NDArray[Any]) -> bytes:
    """PNG bytes of uint8 [H, W, 3] (sRGB), uint8 [H, W] (grey, labels) or uint16 [H, W] (heights).

    Raises:
        ImageError: another type or shape, or no pixel.
    """
    colour = image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8
    grey = image.ndim == 2 and image.dtype in (np.uint8, np.uint16)
    if not (colour or grey) or image.size == 0:
        raise ImageError(
            f"A {image.dtype} array of shape {image.shape} cannot be a PNG here; give uint8 [H, W, 3], "
            "uint8 [H, W] or uint16 [H, W] (to_uint8 converts floats)."
        )
    pixels = np.ascontiguousarray(image[..., ::-1]) if colour else np.ascontiguousarray(image)
    done, data = cv2.imencode(".png", pixels)
    if not done:
        raise ImageError(f"OpenCV could not encode a {image.dtype} image of shape {image.shape} as PNG.")
    return bytes(data.tobytes())


def image_cell(image: npt.NDArray[Any]) -> dict[str, bytes | None]:
    """The value of an image column for an array that `encode_png` takes."""
    return {"bytes": encode_png(image), "path": None}


def _decoded(data: bytes) -> npt.NDArray[Any]:
    # A PNG without its last chunk was cut off; OpenCV would print a second message on stderr.
    whole = data and (not data.startswith(PNG) or b"IEND" in data)
    if data.startswith(PNG) and (area := int.from_bytes(data[16:20]) * int.from_bytes(data[20:24])) > MAX_PIXELS:
        raise ImageError(f"A PNG has {area} pixels, and at most {MAX_PIXELS} are read; make it smaller.")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED) if whole else None
    except cv2.error:  # beyond OpenCV's own limits
        pixels = None
    if pixels is None:
        raise ImageError(f"A PNG ({len(data)} bytes) is not a readable image; it may be cut off or corrupt.")
    return np.ascontiguousarray(pixels[..., ::-1]) if pixels.ndim == 3 else pixels


def decode_png(data: bytes) -> npt.NDArray[Any]:
    """The array that `encode_png` was given: uint8 [H, W, 3], uint8 [H, W] or uint16 [H, W].

    Raises:
        ImageError: unreadable, or of another kind (transparent, 16 bits of colour).
    """
    image = _decoded(data)
    colour = image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8
    if not colour and not (image.ndim == 2 and image.dtype in (np.uint8, np.uint16)):
        raise ImageError(
            f"A PNG holds {image.dtype} of shape {image.shape}; tables hold 8-bit RGB, 8-bit grey or 16-bit "
            "grey. Save it again without transparency."
        )
    # Another program's picture may hold a colour profile or an orientation; `encode_png` writes neither.
    return decode_image(data, "A PNG") if colour and _SAYS_MORE.search(data, 0, data.find(b"IDAT")) else image


def png_shape(data: bytes) -> tuple[int, int]:
    """Height and width of what `decode_png` returns, without decoding a plain PNG.

    Raises:
        ImageError: as `decode_png`.
    """
    if not data.startswith(PNG) or _SAYS_MORE.search(data, 0, data.find(b"IDAT")):
        height, width = decode_png(data).shape[:2]
        return height, width
    return int.from_bytes(data[20:24]), int.from_bytes(data[16:20])


def recorded_pixels_per_m(cell: Any, window_m: Any) -> float:
    """Pixels a metre of an image cell over its window; NaN where loading its row will say what is wrong."""
    try:
        return pixels_per_m(png_shape(cell["bytes"]), window_m)
    except (PentimentoError, TypeError):
        return math.nan


def decode_image(data: bytes, name: str) -> npt.NDArray[np.uint8]:
    """Bytes of any image file (PNG, JPEG, ...) as uint8 sRGB [H, W, 3]; ``name`` describes it in messages.

    It is upright, in sRGB whatever its colour profile, and on white paper where it is transparent.

    Raises:
        ImageError: unreadable, too large, or its colours have no unique meaning in sRGB.
    """
    return decode_picture(data, name)


def read_image(path: Path) -> npt.NDArray[np.uint8]:
    """Any image file (PNG, JPEG, ...) as uint8 sRGB [H, W, 3], see `decode_image`.

    Raises:
        ImageError: missing, or as `decode_image`.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ImageError(f"Image {path} cannot be opened ({error.strerror}); check the path.") from error
    return decode_image(data, f"Image {path}")


def write_png(path: Path, image: npt.NDArray[Any]) -> None:
    """Write an image as PNG, atomically; types as in `encode_png`."""
    atomic_write(Path(path), encode_png(image))


def ink_encoded_to_srgb(grey: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Rows with `encoding` = `ink` hold grey = 255 - ink mask: black ink on white paper, as sRGB [H, W, 3].

    Raises:
        ImageError: not uint8 [H, W] or [H, W, 3].
    """
    if grey.dtype != np.uint8 or grey.ndim not in (2, 3) or (grey.ndim == 3 and grey.shape[2] != 3):
        raise ImageError(f"An ink-encoded image is uint8 [H, W], not {grey.dtype} of shape {grey.shape}.")
    return grey.copy() if grey.ndim == 3 else np.repeat(grey[:, :, None], 3, axis=2)
