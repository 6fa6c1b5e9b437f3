"""Pictures that people bring: files of any common format, read as the sRGB pixels that a viewer shows.

Pillow decodes. The size is checked before the decoding, the orientation and the colour profile are applied, and what
shows through transparent pixels is white paper. A picture whose colours have no unique meaning in sRGB is refused.
"""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps

from pentimento.contracts.errors import ImageError

MAX_PIXELS: Final = 128_000_000
"""Larger pictures are refused before they are decoded."""
PNG: Final = b"\x89PNG"
"""The first bytes of a PNG."""

_PLAIN: Final = ("1", "L", "P", "RGB", "LA", "PA", "RGBA", "YCbCr", "CMYK")
_SIXTEEN: Final = ("I;16", "I;16B", "I;16L")
_DEEP: Final = (*_SIXTEEN, "I", "F")
_PHOTOMETRIC, _WHITE_IS_ZERO, _NO_DATA = 262, 0, 42113
"""A TIFF's tag of how grey is counted, its value where 0 is white, and GDAL's tag of the height that means none."""
_FARTHEST: Final = 1e30
"""Height in any unit."""
_TWELVE_BITS: Final = 4096
_PAPER: Final = (255, 255, 255, 255)
_GAMMA: Final = 1 / 2.2
_PRIMARIES: Final = (0.3127, 0.329, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06)
"""White, red, green and blue of sRGB, in CIE x, y: as in a PNG's chunk cHRM."""
_CORRUPT: Final = (
    OSError, SyntaxError, ValueError, EOFError, LookupError, TypeError, ArithmeticError, struct.error, zlib.error,
)  # fmt: skip
"""What Pillow raises for damaged files."""


class PictureError(ImageError):
    """A file is no picture that can be read."""

    def __init__(self, name: str, reason: str, sentence: str) -> None:
        super().__init__(f"{name} {sentence}")
        self.reason = reason
        """In a few words, the same for all such pictures."""


def decode_picture(data: bytes, name: str, *, plain: bool = False) -> NDArray[np.uint8]:
    """The sRGB pixels [H, W, 3] of a picture file, upright; of an animation the first frame.

    Args:
        name: describes the file in messages, e.g. "Image a.png".
        plain: refuse transparent pictures and those of 16 bits, which may be heights.

    Raises:
        PictureError: unreadable, too large, or its colours have no unique meaning in sRGB.
    """
    with _opened(data, name) as picture:
        if picture.mode not in (_PLAIN if plain else (*_PLAIN, *_SIXTEEN)):
            raise PictureError(
                name,
                f"colour mode {picture.mode}",
                f"has the colour mode {picture.mode}, which is no picture here; save it as 8-bit RGB.",
            )
        profile = picture.info.get("icc_profile")
        if profile is None:
            _require_srgb(picture, data, name)
        with _damage(data, name):
            picture.load()
            upright = ImageOps.exif_transpose(picture)
        if upright.mode in _DEEP:
            upright = _of_8_bits(_deep(upright, picture), upright.info.get("transparency"), name)
        if "A" in upright.mode or "transparency" in upright.info:
            upright = upright.convert("RGBA")
            alpha = upright.getchannel("A")
            if alpha.getextrema() == (255, 255):
                upright = upright.convert("RGB")
            elif plain:
                raise PictureError(name, "transparent", "is transparent; put it on its paper, and save it again.")
            else:
                shown = _applied(upright.convert("RGB"), profile, name).convert("RGBA")
                shown.putalpha(alpha)
                paper = Image.new("RGBA", shown.size, _PAPER)
                return np.array(Image.alpha_composite(paper, shown).convert("RGB"), dtype=np.uint8)
        return np.array(_applied(upright, profile, name), dtype=np.uint8)


def decode_deep(data: bytes, name: str) -> NDArray[Any] | None:
    """The numbers [H, W] of a grey PNG or TIFF with 16 or more bits a pixel; None for any other picture.

    NaN are the pixels that a GeoTIFF marks as not measured.

    Raises:
        PictureError: unreadable, too large, or with 16 bits of colour or transparency.
    """
    with _opened(data, name) as picture:
        if data.startswith(PNG) and data[24:25] == b"\x10" and picture.mode not in _DEEP:
            raise PictureError(
                name,
                "16-bit colour",
                "has 16 bits of colour or transparency: save heights as 16-bit grey without alpha, a picture as 8-bit "
                "RGB.",
            )
        if picture.mode not in _DEEP:
            return None
        with _damage(data, name):
            picture.load()
            return _without_no_data(_deep(picture, picture), picture)


def _deep(pixels: Image.Image, file: Image.Image) -> NDArray[Any]:
    """The numbers [H, W] of a grey picture of 16 or more bits; 0 is black also where a TIFF counts from white."""
    numbers = np.array(pixels)
    if _tags(file).get(_PHOTOMETRIC) != _WHITE_IS_ZERO:
        return numbers
    if pixels.mode not in _SIXTEEN:
        raise ValueError("numbers that count from white have no largest one")
    return 65535 - numbers


def _of_8_bits(numbers: NDArray[Any], transparent: Any, name: str) -> Image.Image:
    """A grey picture of 16 bits as 8 bits; ``transparent`` is the value that is seen through, or None."""
    if 0 < numbers.max(initial=0) < _TWELVE_BITS:
        raise PictureError(
            name,
            "12 bits in 16",
            f"has 16 bits a pixel and no value above {_TWELVE_BITS - 1}, as cameras of 12 bits and less write, and "
            "would be nearly black: stretch it to the whole range, or save it with 8 bits.",
        )
    grey = Image.fromarray(np.rint(numbers / 257.0).astype(np.uint8))
    if transparent is not None:
        grey.putalpha(Image.fromarray(np.where(numbers == transparent, 0, 255).astype(np.uint8)))
    return grey


def _without_no_data(numbers: NDArray[Any], file: Image.Image) -> NDArray[Any]:
    """With NaN where a GeoTIFF says that nothing was measured, and for the largest numbers, which some use for it."""
    found = np.zeros(numbers.shape, bool)
    if (text := _tags(file).get(_NO_DATA)) is not None:
        found = np.isclose(numbers, float(str(text).strip("\0 ")), rtol=1e-6, atol=0.0)
    if numbers.dtype.kind == "f":
        found |= np.abs(numbers) > _FARTHEST
    return np.where(found, np.nan, numbers) if found.any() else numbers


def _tags(file: Image.Image) -> Mapping[int, Any]:
    return getattr(file, "tag_v2", {})


@contextmanager
def _opened(data: bytes, name: str) -> Iterator[Image.Image]:
    """The picture, not decoded yet, with its size checked."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of harmless metadata, and of large pictures
        with _damage(data, name):
            if data.startswith(PNG) and b"IEND" not in data:
                raise ValueError("cut off")
            try:
                picture = Image.open(io.BytesIO(data))
            except Image.DecompressionBombError as error:
                raise PictureError(name, f"more than {MAX_PIXELS} pixels", _too_large(_header_size(data))) from error
        with picture:
            if picture.width * picture.height > MAX_PIXELS:
                raise PictureError(name, f"more than {MAX_PIXELS} pixels", _too_large(picture.size))
            yield picture


@contextmanager
def _damage(data: bytes, name: str) -> Iterator[None]:
    try:
        yield
    except ImageError:
        raise
    except _CORRUPT as error:
        raise PictureError(
            name,
            "not a readable picture",
            f"({len(data)} bytes) is not a readable image; it may be cut off or corrupt.",
        ) from error


def _header_size(data: bytes) -> tuple[int, int] | None:
    """Width and height in a PNG's header."""
    if not data.startswith(PNG) or len(data) < 24:
        return None
    width, height = struct.unpack(">II", data[16:24])
    return int(width), int(height)


def _too_large(size: tuple[int, int] | None) -> str:
    pixels = "too many pixels" if size is None else f"{size[0]} x {size[1]} pixels"
    return f"has {pixels}, and at most {MAX_PIXELS / 1e6:g} million are read; make it smaller."


def _require_srgb(picture: Image.Image, data: bytes, name: str) -> None:
    """Refuse a picture without a profile whose numbers are told to be no sRGB."""
    if picture.mode == "CMYK":
        raise PictureError(
            name, "colour mode CMYK", "holds inks (CMYK) without a colour profile; save it as RGB, in sRGB."
        )
    if space := _foreign_space(picture, data):
        raise PictureError(name, "not in sRGB", f"is {space}, not in sRGB, and has no profile; save it in sRGB.")


def _foreign_space(picture: Image.Image, data: bytes) -> str | None:
    """What a file without a profile says of its colours, unless it is sRGB."""
    info = picture.info
    if data.startswith(PNG):
        head = data[: data.find(b"IDAT")]
        at = head.find(b"cICP")
        if at >= 0:
            primaries, curve = head[at + 4 : at + 6]
            return None if (primaries == 1 and curve in (1, 6, 13)) else f"in the colour space {primaries}/{curve}"
        if "srgb" in info:
            return None
        if "gamma" in info and abs(info["gamma"] - _GAMMA) > 0.02:
            return f"stored with the gamma {info['gamma']:.3g}"
        found = info.get("chromaticity")
        if found is not None and max(abs(a - b) for a, b in zip(found, _PRIMARIES, strict=True)) > 0.01:
            return "stored with other primaries"
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            exif = picture.getexif()
            fields, interoperability = exif.get_ifd(0x8769), exif.get_ifd(0xA005)
        except _CORRUPT:  # a damaged EXIF block says nothing of the colours
            return None
    adobe = fields.get(0xA001) == 2 or str(interoperability.get(1, "")).startswith("R03")
    return "in Adobe RGB" if adobe else None


def _applied(picture: Image.Image, profile: bytes | None, name: str) -> Image.Image:
    """The picture as sRGB, mode RGB. One whose profile is sRGB, up to rounding, keeps its numbers."""
    if profile is None:
        return picture.convert("RGB")
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        space = source.profile.xcolor_space.strip()
        mode = {"RGB": "RGB", "GRAY": "L", "CMYK": "CMYK"}[space]
        if mode == "RGB" and picture.mode != "CMYK":
            picture = picture.convert("RGB")
        elif mode == "L" and picture.mode in ("1", "L"):
            picture = picture.convert("L")
        elif mode == "L" and _is_grey(picture):
            picture = picture.convert("RGB").getchannel(0)
        elif mode != picture.mode:
            raise ValueError(f"a {space} profile in a {picture.mode} picture")
        transform = ImageCms.buildTransform(
            source, ImageCms.createProfile("sRGB"), mode, "RGB", ImageCms.Intent.RELATIVE_COLORIMETRIC,
            ImageCms.Flags.BLACKPOINTCOMPENSATION,
        )  # fmt: skip
        if mode != "CMYK" and _changes_nothing(transform, mode):
            return picture.convert("RGB")
        converted = ImageCms.applyTransform(picture, transform)
    except (ImageCms.PyCMSError, *_CORRUPT) as error:
        raise PictureError(
            name,
            "unreadable colour profile",
            f"has a colour profile that cannot be applied ({error}); save it in sRGB.",
        ) from error
    assert converted is not None  # it is None only in place
    return converted


def _is_grey(picture: Image.Image) -> bool:
    if picture.mode != "RGB":
        return False
    red, green, blue = (np.asarray(picture.getchannel(channel)) for channel in range(3))
    return bool((red == green).all() and (green == blue).all())


def _changes_nothing(transform: ImageCms.ImageCmsTransform, mode: str) -> bool:
    levels = np.linspace(0, 255, 18).round().astype(np.uint8)
    if mode == "L":
        probe = np.arange(256, dtype=np.uint8)[None]
        shown = np.repeat(probe[..., None], 3, axis=2)
    else:
        probe = shown = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(1, -1, 3)
    changed = np.asarray(ImageCms.applyTransform(Image.fromarray(probe), transform))
    return bool(np.abs(changed.astype(int) - shown).max() <= 1)
