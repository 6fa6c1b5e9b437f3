"""A sample of the million commands that `python -m benchmarks.envelope` sends against the envelope."""

import dataclasses
import math

import numpy as np
import pytest

from benchmarks.envelope import CANVAS_M, TOOLS, attack, breaks, smooth_paths
from pentimento.contracts.errors import EnvelopeViolation
from pentimento.control.safety import SafetyEnvelope, envelope_for
from pentimento.robots.tools import load_tool

COMMANDS = 40_000


@pytest.fixture(scope="module")
def tally():
    return attack(COMMANDS, seed=20261121)


def test_attack_no_path_outside_a_limit_reaches_the_driver(tally) -> None:
    assert tally.escaped == []


def test_attack_no_path_well_inside_is_refused(tally) -> None:
    assert tally.refused_inside == []


def test_attack_tries_every_kind_of_command(tally) -> None:
    """Every kind of command was sent many times, and many of those that can be valid were accepted."""
    assert tally.sent.total() == COMMANDS and min(tally.sent.values()) > 1500
    assert tally.reached.total() > 0.1 * COMMANDS
    for kind in ("left as it is", "at a wall", "a jump", "a turn", "too fast", "other rest", "fickle"):
        assert tally.reached[kind] > 100, kind
    for kind in ("not a number", "wrong shape"):
        assert tally.reached[kind] == 0, kind


def test_attack_oracle_detects_each_broken_limit() -> None:
    """The oracle detects a violation of one per mille of each limit."""
    envelope = envelope_for(load_tool("round_brush"), CANVAS_M)
    path = np.zeros((9, 5))
    path[:, 0] = np.linspace(0, 1, 9)
    path[:, 1], path[:, 2] = np.linspace(0.1, 0.11, 9), 0.1
    assert breaks(path, envelope, margin=0.01) is None
    for column, value, verdict in (
        (1, 0.3001, "x"), (1, -1e-4, "x"), (2, 0.2001, "y"), (3, -0.00401, "z"), (3, 0.0501, "z"),
        (4, 6.2895, "yaw"), (0, 30.1, "duration"), (0, -0.1, "start"), (0, math.nan, "not finite"),
    ):  # fmt: skip
        worse = path.copy()
        worse[0, column] = value
        assert breaks(worse, envelope, margin=0.0) == verdict
    for narrowed, verdict in (
        ({"max_speed_m_s": 0.00999}, "speed"),
        ({"max_acceleration_m_s2": 0.1598}, "acceleration"),
    ):
        assert breaks(path, dataclasses.replace(envelope, **narrowed), margin=0.0) == verdict
    turning = path.copy()
    turning[:, 4] = np.linspace(0, 3.15, 9)
    assert breaks(turning, envelope, margin=0.0) == "yaw rate"
    hurried = path.copy()
    hurried[4:, 0] -= hurried[4, 0] - hurried[3, 0] - 9e-4
    assert breaks(hurried, envelope, margin=0.0) == "control period"
    assert breaks(path.tolist(), envelope, margin=0.0) == "shape"


class Gate(SafetyEnvelope):
    """An envelope without checks, which the attack must detect."""

    def checked_copy(self, path: np.ndarray) -> np.ndarray:
        return np.array(path, dtype=np.float64)


@pytest.mark.parametrize("name", TOOLS)
def test_attack_detects_an_envelope_without_checks(name: str) -> None:
    envelope = envelope_for(load_tool(name), CANVAS_M)
    open_gate = Gate(**dataclasses.asdict(envelope))
    paths = smooth_paths(np.random.default_rng(3), envelope, 100)
    verdicts = {breaks(open_gate.checked_copy(path), envelope, margin=0.0) for path in paths}
    assert {"speed", "acceleration"} & verdicts and None in verdicts
    refused = 0
    for path in paths:
        try:
            envelope.check_path(path)
        except EnvelopeViolation:
            refused += 1
    assert 10 < refused < 90
