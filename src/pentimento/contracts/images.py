"""Pictures in and out: PNG of tables by OpenCV, whose BGR never leaves this module, all other files by Pillow."""

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageCms

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ImageError


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


MAX_PIXELS: Final = 2**27
"""Of a picture: 128 megapixels. A larger one is never decoded."""
_TRANSPARENT: Final = ("RGBA", "LA", "PA")
_PLAIN: Final = ("RGB", "L", "P", "1", *_TRANSPARENT)
"""Pillow's colour modes that are sRGB without a profile."""
_SRGB_GAMMA: Final = 1 / 2.2
_SRGB_CHROMATICITY: Final = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
"""x, y of white, red, green and blue."""
_INTEROPERABILITY: Final = 0xA005
"""EXIF's directory in which cameras write `R03` for Adobe RGB."""
_ORIENTATION: Final = 0x0112
"""EXIF's tag that says how a stored picture must be turned."""
_TURNS: Final = {
    2: Image.Transpose.FLIP_LEFT_RIGHT, 3: Image.Transpose.ROTATE_180, 4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE, 6: Image.Transpose.ROTATE_270, 7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}  # fmt: skip
_GREY: Final = ("L", "1")
NOT_READABLE: Final = "not a readable picture"


class UnusablePicture(ImageError):
    """A picture that cannot be used; ``reason`` is a short one that can be counted."""

    def __init__(self, name: str, reason: str) -> None:
        advice = {NOT_READABLE: "it may be cut off or corrupt"}.get(
            reason, "save it again as an opaque sRGB PNG or JPEG"
        )
        what = "is not a readable image" if reason == NOT_READABLE else f"cannot be used ({reason})"
        super().__init__(f"{name} {what}; {advice}.")
        self.reason = reason


def decode_png(data: bytes) -> npt.NDArray[Any]:
    """The array that `encode_png` was given: uint8 [H, W, 3], uint8 [H, W] or uint16 [H, W].

    A picture of another program with an orientation, a colour profile, or in another format than PNG is read as by
    `decode_image`.

    Raises:
        ImageError: unreadable, or of another kind (transparent, 16 bits of colour).
    """
    chunks = _png_chunks(data)
    heights = data[24:26] == b"\x10\0"  # 16 bits of grey, which are no colours
    if chunks is None or ({b"iCCP", b"eXIf", b"gAMA", b"cHRM"} & set(chunks) and not heights):
        return decode_image(data, "A PNG", paper=None)
    whole = b"IHDR" in chunks and b"IEND" in chunks
    if whole and int.from_bytes(data[16:20]) * int.from_bytes(data[20:24]) > MAX_PIXELS:
        raise UnusablePicture("A PNG", f"more than {MAX_PIXELS} pixels")
    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED) if whole else None
    if pixels is None:
        raise UnusablePicture(f"A PNG ({len(data)} bytes)", NOT_READABLE)
    image = np.ascontiguousarray(pixels[..., ::-1]) if pixels.ndim == 3 else pixels
    colour = image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8
    if not colour and not (image.ndim == 2 and image.dtype in (np.uint8, np.uint16)):
        raise ImageError(
            f"A PNG holds {image.dtype} of shape {image.shape}; tables hold 8-bit RGB, 8-bit grey or 16-bit "
            "grey. Save it again without transparency."
        )
    return image


def _png_chunks(data: bytes) -> list[bytes] | None:
    """The names of a PNG's chunks as far as they are whole; None for another file."""
    if not data.startswith(b"\x89PNG\r\n\x1a\n"):
        return None
    names, place = [], 8
    while place + 12 <= len(data):
        names.append(data[place + 4 : place + 8])
        place += 12 + int.from_bytes(data[place : place + 4])
    return names


def decode_image(
    data: bytes, name: str, *, max_pixels: int = MAX_PIXELS, paper: int | None = 255
) -> npt.NDArray[np.uint8]:
    """Bytes of any image file (PNG, JPEG, TIFF, WebP, ...) as uint8 sRGB [H, W, 3], upright.

    This is the one reader of pictures from outside: an orientation in EXIF is applied, colours are converted to sRGB by
    the picture's profile, and its size is checked before it is decoded.

    Args:
        name: describes the picture in messages.
        paper: grey value on which transparent pictures are laid; None refuses them.

    Raises:
        UnusablePicture: unreadable, too large, of several frames, transparent without ``paper``, or in colours that
            cannot be converted to sRGB.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the size is checked here
            with Image.open(io.BytesIO(data)) as opened:
                if opened.width * opened.height > max_pixels:
                    raise UnusablePicture(name, f"more than {max_pixels} pixels")
                return _srgb(opened, name, paper)
    except UnusablePicture:
        raise
    except Image.DecompressionBombError:
        raise UnusablePicture(name, f"more than {max_pixels} pixels") from None
    except Exception as error:  # Pillow's readers raise any exception for a damaged file
        raise UnusablePicture(f"{name} ({len(data)} bytes)", NOT_READABLE) from error


def _srgb(opened: Image.Image, name: str, paper: int | None) -> npt.NDArray[np.uint8]:
    profile = opened.info.get("icc_profile")
    if opened.mode not in _PLAIN and not (opened.mode == "CMYK" and profile):
        raise UnusablePicture(name, f"colour mode {opened.mode}")
    if getattr(opened, "n_frames", 1) > 1 and opened.format != "MPO":  # phones put a second view into MPO
        raise UnusablePicture(name, "more than one frame")
    opened.load()
    if opened.format == "PNG" and not profile and not _png_is_srgb(opened.info):
        raise UnusablePicture(name, "colours that are not sRGB and have no profile")
    if not profile and str(opened.getexif().get_ifd(_INTEROPERABILITY).get(1, "")).startswith("R03"):
        raise UnusablePicture(name, "colours that are Adobe RGB and have no profile")
    coloured: Image.Image = opened
    alpha = None
    if opened.mode in _TRANSPARENT or "transparency" in opened.info:
        with_alpha = opened.convert("RGBA")
        alpha = with_alpha.getchannel("A")
        coloured = opened.convert("L") if opened.mode == "LA" else with_alpha.convert("RGB")
        if paper is None and alpha.getextrema() != (255, 255):
            raise UnusablePicture(name, "transparent")
    picture = _with_profile(coloured, profile, name) if profile else coloured.convert("RGB")
    if alpha is not None and paper is not None:
        picture = Image.composite(picture, Image.new("RGB", picture.size, (paper,) * 3), alpha)
    orientation = opened.getexif().get(_ORIENTATION, 1)
    turned = picture.transpose(_TURNS[orientation]) if orientation in _TURNS else picture
    return np.array(turned, dtype=np.uint8)


def _png_is_srgb(info: Mapping[Any, Any]) -> bool:
    """Whether a PNG without a profile names no other gamma and primaries than those of sRGB."""
    if "srgb" in info:
        return True
    gamma, chromaticity = info.get("gamma", _SRGB_GAMMA), info.get("chromaticity", _SRGB_CHROMATICITY)
    return abs(gamma - _SRGB_GAMMA) < 0.01 and np.allclose(chromaticity, _SRGB_CHROMATICITY, atol=0.01)


def _with_profile(opened: Image.Image, data: bytes, name: str) -> Image.Image:
    """The colours of a picture with an ICC profile as sRGB."""
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(data))
        space = profile.profile.xcolor_space.strip()
        mode = {"RGB": "RGB", "GRAY": "L", "CMYK": "CMYK"}.get(space, "")
        if not mode or (opened.mode == "CMYK") != (mode == "CMYK") or (mode == "L" and opened.mode not in _GREY):
            raise UnusablePicture(name, f"colour mode {opened.mode} with a profile for {space}")
        converted = ImageCms.profileToProfile(
            opened.convert(mode), profile, ImageCms.createProfile("sRGB"),
            ImageCms.Intent.RELATIVE_COLORIMETRIC, "RGB", flags=ImageCms.Flags.BLACKPOINTCOMPENSATION,
        )  # fmt: skip
    except (ImageCms.PyCMSError, OSError, ValueError) as error:
        raise UnusablePicture(name, "a colour profile that cannot be read") from error
    assert converted is not None  # it is None only when converted in place
    return converted


def read_image(path: Path) -> npt.NDArray[np.uint8]:
    """Any image file (PNG, JPEG, ...) as uint8 sRGB [H, W, 3], see `decode_image`.

    Raises:
        ImageError: missing or unusable.
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
