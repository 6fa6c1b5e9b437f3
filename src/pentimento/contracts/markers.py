"""The ArUco markers printed on the table round the canvas.

Printing and detection both read their places here.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from pentimento.contracts.errors import ContractError

DICTIONARY: Final = "DICT_4X4_50"
"""Name of the dictionary in `cv2.aruco`."""
MARGIN_M: Final = 0.020
"""Width of the strip of table round the canvas that holds the markers."""
SIDE_M: Final = 0.014
"""Side of a marker's black square: 3 mm of white on each side within the strip, which ArUco needs."""


@dataclass(frozen=True, eq=False)
class MarkerLayout:
    """Which markers lie where; all upright (their top towards +y)."""

    ids: tuple[int, ...]
    centres_m: npt.NDArray[np.float64]
    """[K, 2] canvas frame."""
    side_m: float

    def corners_m(self) -> npt.NDArray[np.float64]:
        """[K, 4, 2] canvas frame, in ArUco's order: top left, top right, bottom right, bottom left."""
        half = self.side_m / 2
        offsets = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
        return np.asarray(self.centres_m[:, None, :] + offsets)


def markers_around(canvas_size_m: tuple[float, float]) -> MarkerLayout:
    """Eight markers round a canvas (width, height): corners and mid-edges, ids 0..7 counter-clockwise
    from the lower left corner, their centres `MARGIN_M / 2` outside the canvas.

    Raises:
        ContractError: the canvas is so small that markers would overlap.
    """
    width, height = canvas_size_m
    if min(width, height) < 2 * MARGIN_M:
        raise ContractError(
            f"A canvas of {width} x {height} m has no room for 8 markers; each side needs {2 * MARGIN_M} m."
        )
    out = MARGIN_M / 2
    left, middle_x, right = -out, width / 2, width + out
    low, middle_y, high = -out, height / 2, height + out
    ring = [(left, low), (middle_x, low), (right, low), (right, middle_y)]
    ring += [(right, high), (middle_x, high), (left, high), (left, middle_y)]
    return MarkerLayout(ids=tuple(range(8)), centres_m=np.array(ring), side_m=SIDE_M)
