import io
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from PIL import Image, ImageCms

from pentimento.contracts import images
from pentimento.contracts.errors import ImageError
from pentimento.contracts.images import (
    UnusablePicture,
    decode_image,
    decode_png,
    encode_png,
    ink_encoded_to_srgb,
    read_image,
    write_png,
)

RNG = np.random.default_rng(0)
COLOUR = RNG.integers(0, 256, (5, 7, 3), dtype=np.uint8)
GREY = RNG.integers(0, 256, (5, 7), dtype=np.uint8)
HEIGHTS = RNG.integers(0, 65536, (5, 7), dtype=np.uint16)


@pytest.mark.parametrize("image", [COLOUR, GREY, HEIGHTS, COLOUR[::-1, 1:4]], ids=["rgb", "grey", "u16", "view"])
def test_png_round_trip(image: np.ndarray) -> None:
    decoded = decode_png(encode_png(image))
    assert decoded.dtype == image.dtype
    assert_array_equal(decoded, image)


def test_the_first_channel_in_the_file_is_red() -> None:
    red = np.zeros((2, 2, 3), np.uint8)
    red[..., 0] = 255
    by_opencv = cv2.imdecode(np.frombuffer(encode_png(red), np.uint8), cv2.IMREAD_COLOR)
    assert_array_equal(by_opencv[0, 0], [0, 0, 255])  # BGR


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 4)),
        np.zeros((4, 4, 4), np.uint8),
        np.zeros((0, 4), np.uint8),
        np.zeros((2, 2, 3), np.uint16),
    ],
)
def test_other_arrays_are_refused(image: np.ndarray) -> None:
    with pytest.raises(ImageError, match="cannot be a PNG"):
        encode_png(image)


@pytest.mark.parametrize("data", [b"", b"not an image", encode_png(COLOUR)[:30]])
def test_unreadable_bytes_are_an_error(data: bytes) -> None:
    with pytest.raises(ImageError, match="not a readable image"):
        decode_png(data)


def test_transparency_is_refused_because_its_colour_is_ambiguous() -> None:
    data = cv2.imencode(".png", np.zeros((3, 3, 4), np.uint8))[1].tobytes()
    with pytest.raises(ImageError, match="without transparency"):
        decode_png(data)


def test_images_survive_writing_and_reading_files(tmp_path: Path) -> None:
    write_png(tmp_path / "new" / "grey.png", GREY)
    assert_array_equal(read_image(tmp_path / "new" / "grey.png"), np.repeat(GREY[..., None], 3, axis=2))
    write_png(tmp_path / "colour.png", COLOUR)
    assert_array_equal(read_image(tmp_path / "colour.png"), COLOUR)


def test_missing_and_damaged_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"gone\.png cannot be opened"):
        read_image(tmp_path / "gone.png")
    (tmp_path / "bad.png").write_bytes(b"GIF8")
    with pytest.raises(ImageError, match=r"bad\.png .* not a readable image"):
        read_image(tmp_path / "bad.png")


def test_a_png_that_was_cut_off_is_an_error_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    data = encode_png(COLOUR)
    for length in (20, len(data) // 2, len(data) - 12):
        with pytest.raises(ImageError, match="cut off"):
            decode_png(data[:length])
    assert capfd.readouterr() == ("", "")


def test_ink_is_black_on_white() -> None:
    ink = np.array([[0, 255]], np.uint8)
    assert_array_equal(ink_encoded_to_srgb(255 - ink), [[[255] * 3, [0] * 3]])
    with pytest.raises(ImageError, match="uint8"):
        ink_encoded_to_srgb(HEIGHTS)  # type: ignore[arg-type]


def saved(picture: Image.Image, kind: str = "PNG", **options: Any) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, kind, **options)
    return stream.getvalue()


def sheet() -> Image.Image:
    """A grey sheet with a blue L, red at its end: no two of its eight orientations are equal."""
    pixels = np.full((40, 60, 3), 235, np.uint8)
    pixels[4:36, 8:14] = pixels[30:36, 8:40] = (20, 30, 200)
    pixels[30:36, 34:40] = (200, 20, 30)
    return Image.fromarray(pixels)


SHEET = np.asarray(sheet())
STORED = {  # by EXIF's orientation: how the upright sheet is stored
    1: SHEET, 2: SHEET[:, ::-1], 3: SHEET[::-1, ::-1], 4: SHEET[::-1], 5: SHEET.transpose(1, 0, 2),
    6: SHEET.transpose(1, 0, 2)[::-1], 7: SHEET.transpose(1, 0, 2)[::-1, ::-1], 8: SHEET.transpose(1, 0, 2)[:, ::-1],
}  # fmt: skip


@pytest.mark.parametrize("orientation", STORED)
@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF", "WEBP"])
def test_pictures_are_upright(kind: str, orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    options = {"quality": 100} | ({"lossless": True} if kind == "WEBP" else {})
    data = saved(Image.fromarray(np.ascontiguousarray(STORED[orientation])), kind, exif=exif, **options)
    found = decode_image(data, "A sheet")
    assert found.shape == SHEET.shape
    assert np.abs(found.astype(int) - SHEET).mean() < 2
    if kind == "PNG":
        assert_array_equal(decode_png(data), SHEET)


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P", "RGB"])
def test_transparent_pictures_lie_on_white_paper(mode: str) -> None:
    pixels = np.zeros((2, 3, 4), np.uint8)  # black below what is transparent
    pixels[:, 2] = (100, 100, 100, 255)
    pixels[:, 1] = (100, 100, 100, 128 if mode in ("RGBA", "LA") else 0)
    data = saved(Image.fromarray(pixels).convert(mode) if mode != "RGB" else Image.fromarray(pixels[..., :3]),
                 **({"transparency": (0, 0, 0)} if mode == "RGB" else {}))  # fmt: skip
    found = decode_image(data, "A sheet")[0]
    assert found[0].tolist() == [255] * 3 and found[2].tolist() == [100] * 3
    if mode in ("RGBA", "LA"):
        assert found[1].tolist() == [177] * 3  # 255 - 128 / 255 * 155
    with pytest.raises(UnusablePicture, match="transparent") as refused:
        decode_image(data, "A sheet", paper=None)
    assert refused.value.reason == "transparent"
    opaque = saved(Image.fromarray(np.dstack([SHEET, np.full(SHEET.shape[:2], 255, np.uint8)])))
    assert_array_equal(decode_image(opaque, "A sheet", paper=None), SHEET)


def profile(swapped: bool = True) -> bytes:
    """The profile of sRGB; ``swapped``: of colours whose red is sRGB's blue, and the reverse."""
    data = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    if swapped:
        data = data.replace(b"rXYZ", b"?", 1).replace(b"bXYZ", b"rXYZ", 1).replace(b"?", b"bXYZ", 1)
    return data


@pytest.mark.parametrize(("kind", "mode"), [("PNG", "RGB"), ("PNG", "RGBA"), ("TIFF", "RGB"), ("PNG", "P")])
def test_colours_are_converted_by_their_profile(kind: str, mode: str) -> None:
    picture = sheet().quantize(8) if mode == "P" else sheet().convert(mode)
    data = saved(picture, kind, icc_profile=profile())
    assert np.abs(decode_image(data, "A sheet").astype(int) - SHEET[..., ::-1]).max() <= 2
    if kind == "PNG":
        assert np.abs(decode_png(data).astype(int) - SHEET[..., ::-1]).max() <= 2
    data = saved(picture, kind, icc_profile=profile(swapped=False))
    assert np.abs(decode_image(data, "A sheet").astype(int) - SHEET).max() <= 2
    grey = saved(sheet().convert("L"), kind, icc_profile=profile(swapped=False))  # a profile for RGB at a grey picture
    assert np.abs(decode_image(grey, "A sheet")[..., 1].astype(int) - np.asarray(sheet().convert("L"))).max() <= 2


def with_chunk(png: bytes, name: bytes, content: bytes) -> bytes:
    chunk = struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
    return png[:33] + chunk + png[33:]


ADOBE_RGB = Image.Exif()
ADOBE_RGB.get_ifd(0x8769)[0xA005] = {1: "R03"}


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (saved(Image.new("CMYK", (4, 4)), "JPEG"), "colour mode CMYK"),
        (saved(Image.new("CMYK", (4, 4)), "JPEG", icc_profile=profile()), "colour mode CMYK with a profile for RGB"),
        (saved(sheet(), icc_profile=b"no profile"), "a colour profile that cannot be read"),
        (saved(Image.fromarray(HEIGHTS)), "colour mode I;16"),
        (saved(Image.new("F", (4, 4)), "TIFF"), "colour mode F"),
        (saved(Image.new("LAB", (4, 4)), "TIFF"), "colour mode LAB"),
        (saved(sheet(), "GIF", save_all=True, append_images=[Image.new("RGB", (60, 40))]), "more than one frame"),
        (saved(sheet(), "TIFF", save_all=True, append_images=[Image.new("RGB", (60, 40))]), "more than one frame"),
        (with_chunk(saved(sheet()), b"gAMA", struct.pack(">I", 100_000)), "colours that are not sRGB"),
        (saved(sheet(), "JPEG", exif=ADOBE_RGB), "colours that are Adobe RGB"),
        (saved(sheet(), "JPEG")[:-200], "not a readable picture"),
        (saved(sheet())[:-40], "not a readable picture"),
        (b"", "not a readable picture"),
    ],
)
def test_pictures_whose_colours_are_unknown_are_refused(data: bytes, reason: str) -> None:
    with pytest.raises(UnusablePicture, match=r"A sheet .*; (save it again|it may be cut off)") as refused:
        decode_image(data, "A sheet")
    assert refused.value.reason.startswith(reason)


def test_gamma_of_srgb_and_sixteen_bits_of_colour_are_read() -> None:
    assert_array_equal(decode_image(with_chunk(saved(sheet()), b"gAMA", struct.pack(">I", 45455)), "A sheet"), SHEET)
    sixteen = cv2.imencode(".png", SHEET[..., ::-1].astype(np.uint16) * 257)[1].tobytes()
    assert_array_equal(decode_image(sixteen, "A sheet"), SHEET)
    heights = with_chunk(encode_png(HEIGHTS), b"gAMA", struct.pack(">I", 100_000))
    assert_array_equal(decode_png(heights), HEIGHTS)  # heights are no colours


def test_a_picture_that_is_too_large_is_not_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    bomb = bytearray(encode_png(COLOUR))
    bomb[16:24] = struct.pack(">II", 30_000, 30_000)
    bomb[29:33] = struct.pack(">I", zlib.crc32(bytes(bomb[12:29])))
    for decode in (decode_png, lambda data: decode_image(data, "A sheet")):
        with pytest.raises(UnusablePicture, match="more than 134217728 pixels"):
            decode(bytes(bomb))
    monkeypatch.setattr(images, "MAX_PIXELS", 34)
    with pytest.raises(UnusablePicture, match="more than 34 pixels"):
        decode_png(encode_png(COLOUR))
    assert decode_image(encode_png(COLOUR), "A sheet", max_pixels=35).shape == COLOUR.shape
