"""Where a photograph lies on the canvas, as a person says it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, ContractError, UnitError
from pentimento.contracts.frames import check_window
from pentimento.contracts.units import parse_quantity

FloatArray = NDArray[np.float64]


class Placement(NamedTuple):
    """What every photograph shows. One of the two is given."""

    edges_m: tuple[float, float, float, float] | None
    """x_min, y_min, x_max, y_max in the paths' frame; where y grows downwards, the two y are its least and greatest."""
    pixels_per_m: float | None
    y_down: bool
    """The paths' y grows downwards: from the photograph's top, or as the edges say."""

    @staticmethod
    def parsed(window: str | None, scale: str | None, y_down: bool) -> Placement:
        """From texts with units, one of which is given: four edges, or pixels over length.

        Raises:
            ConfigError: a text is no such quantity.
        """
        try:
            if scale is not None:
                pixels_per_m = parse_quantity(scale, "px/m")
                if not pixels_per_m > 0:
                    raise ConfigError(
                        f"--scale {scale} is not above zero; write pixels over length, such as '5 px/mm'."
                    )
                return Placement(None, pixels_per_m, y_down)
            edges = [parse_quantity(edge, "m") for edge in (window or "").split(",")]
            return Placement(check_window(edges), None, y_down)
        except (UnitError, ContractError) as error:
            raise ConfigError(
                f"{error} A window is written as left, lower, right, upper edge: '0 mm, 0 mm, 300 mm, 200 mm'."
                if scale is None
                else str(error)
            ) from error

    def window_m(self, shape: tuple[int, int]) -> tuple[float, float, float, float]:
        """x_min, y_min, x_max, y_max of a photograph of ``shape`` (H, W) in the canvas frame (y up).

        Where y grows downwards, the canvas frame's origin is put at the window's lower edge.
        """
        if self.pixels_per_m is not None:
            return 0.0, 0.0, shape[1] / self.pixels_per_m, shape[0] / self.pixels_per_m
        assert self.edges_m is not None
        x_min, y_min, x_max, y_max = self.edges_m
        return (x_min, 0.0, x_max, y_max - y_min) if self.y_down else self.edges_m

    def to_canvas(self, path: FloatArray, shape: tuple[int, int]) -> FloatArray:
        """A path [N, 5] (t, x, y, z, yaw) in the canvas frame: y up, yaw counter-clockwise."""
        if not self.y_down:
            return path
        lowest = self.edges_m[3] if self.edges_m is not None else self.window_m(shape)[3]
        turned = path.copy()
        turned[:, 2] = lowest - path[:, 2]
        turned[:, 4] = -path[:, 4]
        return turned
