import cv2
import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.markers import DICTIONARY, MARGIN_M, markers_around

SIZE = (0.30, 0.20)


def test_markers_lie_on_the_margin_and_nowhere_else() -> None:
    layout = markers_around(SIZE)
    corners = layout.corners_m().reshape(-1, 2)
    inside = (corners > 0).all(axis=1) & (corners < SIZE).all(axis=1)
    assert not inside.any()
    assert (corners >= -MARGIN_M).all() and (corners <= np.array(SIZE) + MARGIN_M).all()
    assert len(set(layout.ids)) == len(layout.centres_m) == 8


def test_layout_is_symmetric_and_markers_do_not_touch() -> None:
    layout = markers_around(SIZE)
    np.testing.assert_allclose(layout.centres_m.mean(axis=0), np.array(SIZE) / 2)
    gaps = np.abs(layout.centres_m[:, None] - layout.centres_m[None]).max(axis=-1) + 9 * np.eye(8)
    assert gaps.min() > 1.3 * layout.side_m


def test_corners_are_in_the_order_in_which_opencv_finds_them() -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    layout, k = markers_around(SIZE), 4000.0
    marker = cv2.aruco.generateImageMarker(dictionary, layout.ids[0], round(layout.side_m * k))
    found, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(np.pad(marker, 20, constant_values=255))
    assert ids is not None and ids.ravel().tolist() == [0]
    pixels = found[0].reshape(4, 2)
    metres = (pixels - pixels.mean(axis=0)) * [1, -1] / k
    np.testing.assert_allclose(metres, layout.corners_m()[0] - layout.centres_m[0], atol=1.0 / k)


def test_a_canvas_without_room_is_refused() -> None:
    with pytest.raises(ContractError, match="no room for 8 markers"):
        markers_around((0.03, 0.2))
