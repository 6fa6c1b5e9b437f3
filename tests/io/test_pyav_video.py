"""Videos that OpenCV does not decode: AV1 through PyAV where it is installed (extra `video`)."""

import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from pentimento.io.lerobot_episodes import Span, opened_video, video_pairs
from pentimento.io.stroke_rows import Refused
from pentimento.io.stroke_videos import first_and_last

FPS, SHAPE = 10, (96, 128, 3)


def shade(number: int) -> int:
    return 40 + 40 * number


def film_av1(path: Path, frames: int) -> None:
    """Grey pictures that become brighter."""
    av = pytest.importorskip("av", reason="PyAV is not installed (extra video)")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libsvtav1", rate=FPS, options={"crf": "10", "preset": "10"})
        stream.height, stream.width, stream.pix_fmt = *SHAPE[:2], "yuv420p"
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(np.full(SHAPE, shade(number), np.uint8), format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def test_episodes_of_an_av1_video_have_their_pictures(tmp_path: Path) -> None:
    film_av1(tmp_path / "film.mp4", 5)
    spans = [Span(0.0, 0.1, 2), Span(0.2, 0.4, 3), Span(0.2, 0.9, 8)]
    first, second, beyond = video_pairs(tmp_path / "film.mp4", list(SHAPE), FPS, spans)
    for pair, numbers in ((first, (0, 1)), (second, (2, 4))):
        assert not isinstance(pair, Refused)
        for picture, number in zip(pair, numbers, strict=True):
            assert picture.shape == SHAPE and np.abs(picture.astype(int) - shade(number)).max() < 6
    assert isinstance(beyond, Refused)


def test_first_and_last_picture_of_an_av1_video(tmp_path: Path) -> None:
    film_av1(tmp_path / "film.mp4", 4)
    first, last = first_and_last(tmp_path / "film.mp4")
    assert abs(first.mean() - shade(0)) < 4 and abs(last.mean() - shade(3)) < 4


def test_a_file_that_is_no_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "film.mp4").write_bytes(b"\0\0\0\x20ftypisom" + bytes(64))
    with pytest.raises(Refused, match=r"film\.mp4 .*encode it again as H\.264"), opened_video(tmp_path / "film.mp4"):
        pass


def test_without_pyav_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    (tmp_path / "film.mp4").write_bytes(b"\0\0\0\x20ftypisom" + bytes(64))
    with pytest.raises(Refused, match=r"pip install 'pentimento\[video\]'"), opened_video(tmp_path / "film.mp4"):
        pass
