from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pentimento.contracts.errors import ImageError
from pentimento.contracts.images import decode_png, encode_png, ink_encoded_to_srgb, read_image, write_png

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
