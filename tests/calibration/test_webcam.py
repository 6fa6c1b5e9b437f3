"""A camera by OpenCV, with one that is not there, and calibrations taken out of its pictures."""

import numpy as np
import pytest

from pentimento.calibration import webcam
from pentimento.calibration.webcam import Webcam, corrected
from pentimento.contracts.errors import CalibrationError
from pentimento.contracts.observations import Photo
from pentimento.robots.calibration import Calibration


class FakeCapture:
    """Frames that count up, in OpenCV's order of colours."""

    opens, gives = True, True

    def __init__(self, number: int) -> None:
        self.frames = 0

    def isOpened(self) -> bool:
        return self.opens

    def grab(self) -> bool:
        self.frames += 1
        return True

    def read(self) -> tuple[bool, np.ndarray | None]:
        self.frames += 1
        frame = np.zeros((4, 6, 3), np.uint8)
        frame[..., 0], frame[..., 2] = 10, self.frames
        return self.gives, frame if self.gives else None

    def release(self) -> None: ...


@pytest.fixture
def capture(monkeypatch: pytest.MonkeyPatch) -> type[FakeCapture]:
    fake = type("Fake", (FakeCapture,), {})
    monkeypatch.setattr(webcam.cv2, "VideoCapture", fake)
    return fake


def test_a_photograph_is_of_now_and_in_rgb(capture: type[FakeCapture]) -> None:
    camera = Webcam(0)
    first, second = camera(), camera()
    assert first.frame[0, 0].tolist() == [5, 0, 10]  # four that waited were thrown away; blue came first
    assert second.frame[0, 0, 0] == 10 and second.t_s >= first.t_s
    assert np.isnan(first.exposure_s) and np.isnan(first.white_balance).all()
    camera.close()


def test_cameras_that_are_not_there_or_give_nothing_say_so(capture: type[FakeCapture]) -> None:
    capture.gives = False
    with pytest.raises(CalibrationError, match="no picture"):
        Webcam(1)()
    capture.opens = False
    with pytest.raises(CalibrationError, match="no camera 1"):
        Webcam(1)


def test_what_calibrations_found_is_taken_out() -> None:
    seen = np.full((4, 6, 3), 188, np.uint8)

    def camera() -> Photo:
        return Photo(seen, 0.01, 1.0, np.ones(3), 0.0)

    assert np.array_equal(corrected(camera, {})().frame, seen)
    halved = {"matrix": (0.5 * np.eye(3)).tolist(), "offset": [0.0, 0.0, 0.0]}
    colour = Calibration("colour", "r", 0.0, "f", 0.1, halved)
    assert np.all(np.abs(corrected(camera, {"colour": colour})().frame.astype(int) - 137) <= 1)  # half the light
