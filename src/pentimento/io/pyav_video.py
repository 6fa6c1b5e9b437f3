"""Videos that OpenCV does not decode, such as AV1, through PyAV (extra `video`): the methods of OpenCV's capture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2

from pentimento.io.stroke_rows import Refused


def pyav_capture(file: Path) -> Capture:
    """A video that has grabbed its first picture.

    Raises:
        Refused: PyAV is not installed, or cannot decode it either.
    """
    try:
        import av
    except ImportError:
        raise Refused(
            f"its video {file.name} cannot be decoded by this build of OpenCV; install PyAV, which decodes AV1 (pip "
            "install 'pentimento[video]'), encode it again as H.264, or keep its pictures as images"
        ) from None
    try:
        capture = Capture(av.open(str(file.absolute())))
        if capture.grab():
            return capture
    except (av.FFmpegError, IndexError) as error:  # IndexError: it has no video stream
        reason = f" ({error.strerror})" if isinstance(error, av.FFmpegError) else ""
        raise Refused(
            f"its video {file.name} can be decoded neither by OpenCV nor by PyAV{reason}; encode it again as H.264"
        ) from error
    raise Refused(f"its video {file.name} has no picture that can be decoded; encode it again as H.264")


class Capture:
    """A video that is read forwards, one picture after the other."""

    def __init__(self, container: Any) -> None:
        """``container`` is one of `av.open`."""
        self._container = container
        self._frames = container.decode(container.streams.video[0])
        self._frame: Any = None

    def grab(self) -> bool:
        """Go to the next picture; False where there is none. What cannot be decoded ends the video."""
        import av

        try:
            self._frame = next(self._frames)
        except (StopIteration, av.FFmpegError):
            return False
        return True

    def retrieve(self) -> tuple[bool, Any]:
        """True and the picture [H, W, 3], BGR."""
        return True, self._frame.to_ndarray(format="bgr24")

    def get(self, what: int) -> float:
        """The picture's time in ms, its height or its width, by OpenCV's numbers of these."""
        values = {
            cv2.CAP_PROP_POS_MSEC: 1000.0 * float(self._frame.time),
            cv2.CAP_PROP_FRAME_HEIGHT: float(self._frame.height),
            cv2.CAP_PROP_FRAME_WIDTH: float(self._frame.width),
        }
        return values[what]

    def release(self) -> None:
        """Close the file."""
        self._container.close()
