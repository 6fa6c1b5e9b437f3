"""Collection of placed pellets, from which the place model is fitted.

Place and diameter are drawn jointly at random. The material is smoothed after every few pellets, and a share of them is
set beside earlier ones, as in sculpting, so that the fit's residual contains what neighbours do.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.control.execute import Session
from pentimento.control.execute_place import execute_place, record_place
from pentimento.robots.driver import SculptingRobot
from pentimento.robots.tools import Feeder, ball_diameter_m, ball_m3

FloatArray = NDArray[np.float64]

_PLACES_STREAM = 2  # random stream, apart from that of the pushes
_PER_SMOOTHING = 6
_BESIDE_SHARE = 0.5
_BESIDE_DIAMETERS = (0.6, 1.2)
"""Distance of a pellet from its neighbour, in diameters of the larger of the two: a wall's pellets touch."""


def design_places(
    feeder: Feeder, area_m: tuple[float, float], *, count: int, edge_m: float, seed: int
) -> list[FloatArray]:
    """Pellets [3] in their order, their diameters uniform in the feeder's range.

    Raises:
        ContractError: the area has no room within its edges.
    """
    low, high = np.full(2, edge_m), np.array(area_m) - edge_m
    if not np.all(low < high):
        raise ContractError(f"An area of {area_m} m has no room for pellets {edge_m:g} m from its edge; lower edge_m.")
    places: list[FloatArray] = []
    for number in range(count):
        rng = np.random.default_rng([seed, number, _PLACES_STREAM])
        diameter_m = rng.uniform(*feeder.diameter_m)
        middle = rng.uniform(low, high)
        earlier = places[number - number % _PER_SMOOTHING :]
        if earlier and rng.random() < _BESIDE_SHARE:
            beside = earlier[int(rng.integers(len(earlier)))]
            larger_m = max(diameter_m, ball_diameter_m(beside[2]))
            turn, away = rng.uniform(-np.pi, np.pi), rng.uniform(*_BESIDE_DIAMETERS) * larger_m
            middle = np.clip(beside[:2] + away * np.array([math.cos(turn), math.sin(turn)]), low, high)
        places.append(np.array([*middle, ball_m3(diameter_m)]))
    return places


def collect_places(
    robot: SculptingRobot, feeder: Feeder, material: str, *, count: int, edge_m: float, seed: int, first: int
) -> list[dict[str, Any]]:
    """Set the pellets of ``design_places``; rows of the ``pushes`` contract in their order.

    Args:
        first: order and action of the first row, such as the number of pushes before them in the table.
    """
    session = Session(f"{material}-{feeder.name}-{seed}", robot.clock_s)
    rows: list[dict[str, Any]] = []
    for number, place in enumerate(design_places(feeder, robot.area_m, count=count, edge_m=edge_m, seed=seed)):
        if number % _PER_SMOOTHING == 0:
            robot.smooth()
        executed = execute_place(robot, feeder, place, robot.scan())
        row = record_place(session, first + number, first + number, feeder=feeder, material=material, executed=executed)
        rows.append(row | {"tool_id": f"{feeder.name}_0"})
    return rows
