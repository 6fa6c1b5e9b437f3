"""Picture files of every kind are read as the sRGB pixels that a viewer shows, or refused in one sentence."""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from PIL import ExifTags, Image, ImageCms

from pentimento.contracts.errors import ImageError
from pentimento.contracts.images import decode_image, decode_png, encode_png, read_image
from pentimento.contracts.picture_files import PictureError, decode_deep, decode_picture

PICTURES = Path(__file__).parent / "pictures"
RED, GREEN = (200, 30, 30), (30, 160, 40)


def opened(name: str) -> Image.Image:
    return Image.open(io.BytesIO((PICTURES / name).read_bytes()))


def saved(picture: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, kind, **options)
    return stream.getvalue()


def read(picture: Image.Image, kind: str = "PNG", **options: object) -> np.ndarray:
    return decode_image(saved(picture, kind, **options), "The picture")


def with_chunk(png: bytes, name: bytes, content: bytes) -> bytes:
    """A PNG with one more chunk after its header."""
    chunk = struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
    return png[:33] + chunk + png[33:]


def logo() -> Image.Image:
    """An opaque red square, 2 x 2, amid transparent black, 4 x 4; its lower right pixel is half transparent."""
    logo = Image.new("RGBA", (4, 4), (0, 0, 0, 0))
    logo.paste((*RED, 255), (1, 1, 3, 3))
    logo.putpixel((2, 2), (0, 0, 0, 128))
    return logo


@pytest.mark.parametrize("kind", ["PNG", "WEBP", "TIFF"])
def test_what_shows_through_transparent_pixels_is_white_paper(kind: str) -> None:
    shown = read(logo(), kind, **({"lossless": True, "exact": True} if kind == "WEBP" else {}))
    assert_array_equal(shown[0, 0], [255, 255, 255])
    assert_array_equal(shown[1, 1], RED)
    assert np.abs(shown[2, 2].astype(int) - 127).max() <= 1


def test_transparent_grey_palettes_and_single_colours_show_paper_too() -> None:
    grey = Image.merge("LA", [Image.new("L", (2, 1), 0), Image.new("L", (2, 1))])
    grey.putpixel((1, 0), (40, 255))
    assert_array_equal(read(grey)[0], [[255] * 3, [40] * 3])
    palette = Image.new("P", (2, 1), 0)
    palette.putpalette([0, 0, 0, *RED])
    palette.putpixel((1, 0), 1)
    for kind in ("PNG", "GIF"):
        assert_array_equal(read(palette, kind, transparency=0)[0], [[255] * 3, RED])
    assert_array_equal(read(palette, "PNG", transparency=b"\x00\xff")[0], [[255] * 3, RED])
    assert_array_equal(read(Image.new("RGB", (2, 1), RED), transparency=RED), np.full((1, 2, 3), 255))
    assert_array_equal(read(Image.new("L", (2, 1), 7), transparency=7), np.full((1, 2, 3), 255))


@pytest.mark.parametrize("name", ["patches_p3.jpg", "patches_adobe.jpg"])
def test_an_embedded_profile_is_applied(name: str) -> None:
    shown = read_image(PICTURES / name).astype(int)
    for colour in (RED, GREEN):
        assert np.abs(shown - colour).max(axis=2).min() <= 3  # JPEG
    untouched = np.asarray(opened(name)).astype(int)
    assert np.abs(untouched - RED).max(axis=2).min() > 15


def wide_profile() -> bytes:
    return bytes(opened("patches_p3.jpg").info["icc_profile"])


def test_profiles_of_transparent_palette_and_grey_pictures_are_applied() -> None:
    wide = wide_profile()
    plain = read(Image.new("RGB", (1, 1), (184, 50, 41)), icc_profile=wide)[0, 0]
    assert np.abs(plain.astype(int) - RED).max() <= 2
    half = read(Image.new("RGBA", (2, 1), (184, 50, 41, 255)), icc_profile=wide)
    assert_array_equal(half[0, 0], plain)
    clear = Image.new("RGBA", (2, 1), (184, 50, 41, 0))
    clear.putpixel((0, 0), (184, 50, 41, 255))
    assert_array_equal(read(clear, icc_profile=wide)[0], [plain, [255] * 3])
    palette = Image.new("P", (1, 1), 0)
    palette.putpalette([184, 50, 41])
    assert_array_equal(read(palette, icc_profile=wide)[0, 0], plain)
    assert_array_equal(read(Image.new("L", (1, 1), 128), icc_profile=wide)[0, 0], [128] * 3)
    png = saved(Image.new("RGB", (1, 1), (184, 50, 41)), icc_profile=wide)
    assert_array_equal(decode_png(png)[0, 0], plain)  # in a table of another program, too


def test_a_profile_of_srgb_changes_no_pixel() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (9, 9, 3), np.uint8)
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert_array_equal(read(Image.fromarray(pixels), icc_profile=profile), pixels)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (saved(Image.new("RGB", (2, 2)), icc_profile=b"no profile"), "colour profile that cannot be applied"),
        (saved(Image.new("CMYK", (2, 2)), "JPEG"), r"inks \(CMYK\) without a colour profile"),
        (saved(Image.new("CMYK", (2, 2)), "JPEG", icc_profile=wide_profile()), "cannot be applied"),
        (saved(Image.new("F", (2, 2)), "TIFF"), "colour mode F"),
        (saved(Image.new("LAB", (2, 2)), "TIFF"), "colour mode LAB"),
        (with_chunk(saved(Image.new("RGB", (2, 2))), b"gAMA", struct.pack(">I", 100_000)), "with the gamma 1"),
        (
            with_chunk(
                saved(Image.new("RGB", (2, 2))),
                b"cHRM",
                struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000),
            ),
            "other primaries",
        ),
        (with_chunk(saved(Image.new("RGB", (2, 2))), b"cICP", bytes([12, 13, 0, 1])), "colour space 12/13"),
    ],
)
def test_colours_without_a_unique_meaning_are_refused(data: bytes, sentence: str) -> None:
    with pytest.raises(ImageError, match=sentence):
        decode_image(data, "The picture")


def test_adobe_rgb_that_only_the_camera_s_exif_tells_is_refused() -> None:
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ColorSpace] = 2
    with pytest.raises(ImageError, match="in Adobe RGB"):
        read(Image.new("RGB", (8, 8)), "JPEG", exif=exif)


def test_the_usual_gamma_and_primaries_are_srgb() -> None:
    png = with_chunk(saved(Image.new("RGB", (1, 1), RED)), b"gAMA", struct.pack(">I", 45455))
    primaries = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
    assert_array_equal(decode_image(with_chunk(png, b"cHRM", primaries), "The picture")[0, 0], RED)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "TIFF"])
def test_pictures_are_turned_upright(kind: str) -> None:
    picture = Image.new("RGB", (32, 16), RED)
    picture.paste(GREEN, (16, 0, 32, 16))
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6  # turn right by 90°: what was on the left is above
    shown = read(picture, kind, exif=exif).astype(int)
    assert shown.shape == (32, 16, 3)
    assert np.abs(shown[4, 8] - RED).max() < 12 and np.abs(shown[-4, 8] - GREEN).max() < 12
    if kind == "PNG":
        assert decode_png(saved(picture, kind, exif=exif)).shape == (32, 16, 3)


def test_a_picture_with_too_many_pixels_is_refused_before_it_is_decoded() -> None:
    small = bytearray(saved(Image.new("L", (8, 8))))
    for width, height in ((40_000, 40_000), (12_000, 12_000)):
        small[16:24] = struct.pack(">II", width, height)
        small[29:33] = struct.pack(">I", zlib.crc32(small[12:29]))
        with pytest.raises(ImageError, match=f"has {width} x {height} pixels.*128 million.*smaller"):
            decode_image(bytes(small), "The picture")
        with pytest.raises(ImageError, match="smaller"):
            decode_png(bytes(small))
    with pytest.raises(ImageError, match="readable image"):  # a broken size within the limits
        small[16:24] = struct.pack(">II", 9000, 9000)
        small[29:33] = struct.pack(">I", zlib.crc32(small[12:29]))
        decode_image(bytes(small), "The picture")


def test_sixteen_bits_of_grey_are_a_picture_or_heights() -> None:
    heights = np.array([[0, 257 * 40], [65535, 257 * 200]], np.uint16)
    for kind in ("PNG", "TIFF"):
        data = saved(Image.fromarray(heights), kind)
        assert_array_equal(decode_picture(data, "It")[..., 0], [[0, 40], [255, 200]])
        assert_array_equal(decode_deep(data, "It"), heights)
        with pytest.raises(PictureError, match="colour mode"):
            decode_picture(data, "It", plain=True)
    metres = np.array([[0.5, np.nan], [0.0, 1.5]], np.float32)
    assert_array_equal(decode_deep(saved(Image.fromarray(metres), "TIFF"), "It"), metres)
    assert decode_deep(encode_png(np.zeros((2, 2), np.uint8)), "It") is None


@pytest.mark.parametrize("kind", ["JPEG", "GIF", "WEBP", "TIFF", "BMP", "PNG"])
def test_a_file_that_was_cut_off_is_refused(kind: str) -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8))
    data = saved(noise, kind)
    for length in (10, len(data) // 2):
        with pytest.raises(ImageError, match="not a readable image; it may be cut off"):
            decode_image(data[:length], "The picture")


def test_a_picture_of_12_bits_in_16_is_refused() -> None:
    numbers = np.linspace(0, 4095, 48).reshape(6, 8).astype(np.uint16)
    with pytest.raises(ImageError, match="no value above 4095"):
        read(Image.fromarray(numbers))
    assert_array_equal(read(Image.fromarray(numbers * 16))[..., 0], np.rint(numbers * 16 / 257))
    assert decode_deep(saved(Image.fromarray(numbers)), "Heights").max() == 4095


def test_a_transparent_grey_of_16_bits_shows_paper() -> None:
    numbers = np.array([[0, 65535], [257 * 100, 0]], np.uint16)
    shown = read(Image.fromarray(numbers), transparency=0)
    assert_array_equal(shown[..., 0], [[255, 255], [100, 255]])
