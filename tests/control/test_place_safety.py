"""The place envelope: pellets outside it never reach the driver."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.control.guard import StoppedError
from pentimento.control.place_safety import place_envelope_for
from pentimento.control.push_safety import GuardedSculptingRobot
from pentimento.robots.driver import Place
from pentimento.robots.tools import ball_m3, load_feeder
from tests.control.test_push_safety import BALL, ENVELOPE, Recorder

FEEDER = load_feeder("pellets")
PLACES = place_envelope_for(FEEDER, (0.2, 0.2))
FINE = Place(0.1, 0.1, ball_m3(0.01), 0.04, 0.002)


class Setter(Recorder):
    """A robot that records its pellets, and fails on demand."""

    def __init__(self) -> None:
        super().__init__()
        self.places: list[Place] = []

    def place(self, place: Place) -> None:
        if self.broken:
            raise OSError("the feeder is empty")
        self.places.append(place)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"x_m": 0.004}, r"off the slab; the place envelope allows x from 0 to 0\.2 m"),
        ({"y_m": 0.21}, "off the slab"),
        ({"x_m": 100.0, "y_m": 100.0}, "look like millimetres"),
        ({"volume_m3": ball_m3(0.02)}, "volume is 4.18879e-06 m³; the place envelope allows"),
        ({"volume_m3": 500.0}, "looks like cubic millimetres"),
        ({"volume_m3": -1e-7}, "volume is -1e-07"),
        ({"x_m": np.nan}, "x_m is nan"),
        ({"volume_m3": "much"}, "volume_m3 is 'much'; it must be a finite number"),
        ({"surface_m": 0.059}, r"pressed to 61 mm above the table is higher .* 60 mm"),
        ({"surface_m": 0.0}, "the first is above 0"),
        ({"press_m": -0.001}, "the second 0 or more"),
    ],
)
def test_pellet_outside_the_envelope_never_reaches_the_driver(change: dict[str, Any], words: str) -> None:
    robot = Setter()
    guarded = GuardedSculptingRobot(robot, ENVELOPE, PLACES)
    with pytest.raises(EnvelopeViolation, match=words):
        guarded.place(replace(FINE, **change))
    assert robot.places == []
    guarded.place(FINE)  # a refusal does not stop the robot
    assert robot.places == [FINE]


def test_random_pellets_pass_exactly_when_their_ball_lies_inside() -> None:
    rng, passed = np.random.default_rng(0), 0
    for _ in range(2000):
        x_m, y_m, diameter_m = rng.uniform([-0.01, -0.01, 0.004], [0.21, 0.21, 0.016])
        inside = all(0.5 * diameter_m <= at <= 0.2 - 0.5 * diameter_m for at in (x_m, y_m))
        inside = inside and FEEDER.diameter_m[0] <= diameter_m <= FEEDER.diameter_m[1]
        try:
            PLACES.check(replace(FINE, x_m=x_m, y_m=y_m, volume_m3=ball_m3(diameter_m)))
        except EnvelopeViolation:
            assert not inside
        else:
            assert inside
            passed += 1
    assert 500 < passed < 1900


def test_robot_without_a_place_envelope_refuses_pellets() -> None:
    robot = Setter()
    with pytest.raises(EnvelopeViolation, match="no place envelope"):
        GuardedSculptingRobot(robot, ENVELOPE).place(FINE)
    assert robot.places == []


def test_robot_stays_stopped_after_a_pellet_failed() -> None:
    robot = Setter()
    guarded = GuardedSculptingRobot(robot, ENVELOPE, PLACES)
    guarded.change_tool(BALL)
    robot.broken = True
    with pytest.raises(OSError, match="empty"):
        guarded.place(FINE)
    robot.broken = False
    with pytest.raises(StoppedError, match="a pellet failed: the feeder is empty"):
        guarded.place(FINE)
    guarded.release()
    guarded.place(FINE)
    assert robot.places == [FINE]


def test_place_envelope_beyond_the_slab_or_empty_is_refused() -> None:
    with pytest.raises(EnvelopeViolation, match="place envelope reaches beyond"):
        GuardedSculptingRobot(Setter(), ENVELOPE, replace(PLACES, x_max_m=0.3))
    with pytest.raises(ConfigError, match="finite"):
        replace(PLACES, max_height_m=np.inf)
    with pytest.raises(ConfigError, match="empty"):
        replace(PLACES, x_max_m=0.0)
    with pytest.raises(ConfigError, match="smaller volume first"):
        replace(PLACES, max_volume_m3=0.0)
