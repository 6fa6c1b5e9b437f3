"""The envelope accepts what lies inside and refuses any single violation; the guard passes nothing else."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pentimento.contracts.errors import ConfigError, EnvelopeViolation
from pentimento.contracts.observations import Photo
from pentimento.control.safety import SafetyEnvelope, envelope_for
from pentimento.robots.driver import MissingAbilityError
from pentimento.robots.motion import MIN_STEP_S, timed_path, tip_accelerations
from pentimento.robots.tools import Tool, load_tool

CANVAS_M = (0.3, 0.2)
TOOLS = ("marker", "round_brush", "flat_brush")
PROPERTY = settings(max_examples=80, deadline=None, derandomize=True, database=None)
BRUSH = envelope_for(load_tool("round_brush"), CANVAS_M)


class FakeRobot:
    """Records every call; implements the Robot interface."""

    canvas_size_m = CANVAS_M
    clock_s = 0.0

    def __init__(self) -> None:
        self.calls: list[tuple[str, Any]] = []

    def change_tool(self, tool: Tool) -> None:
        self.calls.append(("change_tool", tool.name))

    def load_palette(self, colors_srgb: np.ndarray) -> None:
        self.calls.append(("load_palette", colors_srgb))

    def dip(self, paint: int) -> None:
        self.calls.append(("dip", paint))

    def wipe(self) -> None:
        self.calls.append(("wipe", None))

    def force_n(self) -> np.ndarray:
        return np.zeros(0)

    def move(self, path: np.ndarray) -> np.ndarray:
        self.calls.append(("move", path))
        return path

    def photo(self) -> Photo:
        return Photo(np.zeros((2, 2, 3), np.uint8), 0.01, 1.0, np.ones(3), 0.0)

    def scan(self) -> np.ndarray:
        raise MissingAbilityError("none")

    def new_sheet(self) -> None:
        self.calls.append(("new_sheet", None))

    def wait(self, seconds: float) -> None:
        self.calls.append(("wait", seconds))


def bent_stroke(
    tool: Tool,
    length_m: float,
    bend: float,
    heading_rad: float,
    press_m: float,
    speed_m_s: float,
    points: int = 32,
) -> np.ndarray:
    """A stroke about the canvas's centre with a sine of press, timed."""
    s = np.linspace(0, 1, points)
    along, across = length_m * (s - 0.5), 4 * bend * length_m * s * (1 - s)
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    xyz_yaw = np.column_stack(
        (
            CANVAS_M[0] / 2 + cos * along - sin * across,
            CANVAS_M[1] / 2 + sin * along + cos * across,
            -press_m * np.sin(np.pi * s),
            np.full(points, heading_rad),
        )
    )
    return timed_path(xyz_yaw, speed_m_s)


def good_path() -> np.ndarray:
    return bent_stroke(load_tool("round_brush"), 0.03, 0.2, 0.4, 0.002, 0.06)


@PROPERTY
@given(name=st.sampled_from(TOOLS), data=st.data())
def test_envelope_accepts_every_feasible_timed_stroke(name: str, data: st.DataObject) -> None:
    """All lengths, bends, headings, presses and speeds of the tool file; also after rounding to float32."""
    tool = load_tool(name)
    path = bent_stroke(
        tool,
        data.draw(st.floats(*tool.stroke_length_m)),
        data.draw(st.floats(*tool.bend_range)),
        data.draw(st.floats(-math.pi, math.pi)),
        data.draw(st.floats(*tool.press_range_m)),
        data.draw(st.floats(*tool.speed_range_m_s)),
        data.draw(st.sampled_from((2, 3, 8, 32, 64))),
    )
    envelope = envelope_for(tool, CANVAS_M)
    envelope.check_path(path)
    envelope.check_path(path.astype(np.float32))


@PROPERTY
@given(seed=st.integers(0, 2**31), count=st.integers(2, 40), spread_m=st.floats(1e-3, 0.15))
def test_envelope_accepts_a_random_path_only_if_it_keeps_each_limit(seed: int, count: int, spread_m: float) -> None:
    rng = np.random.default_rng(seed)
    xyz_yaw = np.cumsum(rng.normal(size=(count, 4)) * [spread_m / 6, spread_m / 6, 5e-4, 0.2], axis=0)
    xyz_yaw[:, :2] += rng.uniform((0, 0), CANVAS_M)
    path = timed_path(xyz_yaw, rng.uniform(0.03, 0.15), rng.uniform(0.5, 4))
    try:
        BRUSH.check_path(path)
    except EnvelopeViolation:
        assert not keeps_limits(path, tolerance=-1e-6)
    else:
        assert keeps_limits(path, tolerance=1e-6)


def keeps_limits(path: np.ndarray, tolerance: float) -> bool:
    """The brush's limits by definition, each wider by `tolerance`; rates by 1 %, for rounding."""
    low, high = np.array([0, 0, -0.004]) - tolerance, np.array([0.3, 0.2, 0.05]) + tolerance
    dt = np.diff(path[:, 0])
    speed = np.linalg.norm(np.diff(path[:, 1:4], axis=0), axis=1) / dt
    rates = 1 + 0.01 * np.sign(tolerance)
    return bool(
        (path[:, 1:4] >= low).all()
        and (path[:, 1:4] <= high).all()
        and (np.abs(path[:, 4]) <= 2 * math.pi + tolerance).all()
        and speed.max() <= 0.12 * rates
        and (np.abs(np.diff(path[:, 4])) / dt).max() <= math.pi * rates
        and tip_accelerations(path).max() <= 2.5 * rates
        and path[-1, 0] <= 30 * rates
    )


@PROPERTY
@given(point=st.integers(0, 31), column=st.integers(0, 4), bad=st.sampled_from((math.nan, math.inf, -math.inf)))
def test_envelope_rejects_a_non_finite_value_anywhere(point: int, column: int, bad: float) -> None:
    path = good_path()
    path[point, column] = bad
    with pytest.raises(EnvelopeViolation, match=rf"point {point} is (nan|inf|-inf)"):
        BRUSH.check_path(path)


@PROPERTY
@given(
    point=st.integers(0, 31),
    violation=st.sampled_from(
        (
            (1, -1e-5),
            (1, 0.30001),
            (2, -1e-5),
            (2, 0.20001),
            (3, -0.00401),
            (3, 0.05001),
            (4, 6.3),
            (4, -6.3),
            (1, 1e300),
            (2, -1e300),
            (3, 1e300),
            (4, -1e300),
            (0, 1e300),
            (0, -1e300),
            (0, 30.1),
            (0, -1.0),
        )
    ),
)
def test_envelope_rejects_one_point_outside(point: int, violation: tuple[int, float]) -> None:
    path = good_path()
    column, value = violation
    path[point, column] = value
    with pytest.raises(EnvelopeViolation, match=r"The path's .* at point \d+ is .*; the safety envelope allows"):
        BRUSH.check_path(path)


@PROPERTY
@given(point=st.integers(1, 30), jump_m=st.floats(2e-3, 0.01), heading=st.floats(0, 2 * math.pi))
def test_envelope_rejects_one_jump(point: int, jump_m: float, heading: float) -> None:
    """Moving a point by d from a smooth stroke adds an acceleration of about 2 d / dt²: 16 m/s² for 2 mm."""
    path = good_path()
    path[point, 1] += jump_m * math.cos(heading)
    path[point, 2] += jump_m * math.sin(heading)
    with pytest.raises(EnvelopeViolation, match=r"acceleration|speed"):
        BRUSH.check_path(path)


@PROPERTY
@given(first=st.integers(0, 30), seed=st.integers(0, 1000))
def test_envelope_rejects_unsorted_time(first: int, seed: int) -> None:
    path = good_path()
    second = int(np.random.default_rng([seed, first]).integers(first + 1, 32))
    path[[first, second], 0] = path[[second, first], 0]
    with pytest.raises(EnvelopeViolation, match="time"):
        BRUSH.check_path(path)


@pytest.mark.parametrize(
    ("columns", "factor", "hint"),
    [
        ([1, 2, 3], 1000, "metres; these look like millimetres"),
        ([1, 2], 1000, "metres; these look like millimetres"),
        ([3], 1000, "metres; these look like millimetres"),
        ([0], 1000, "seconds; these look like milliseconds"),
        ([4], 180 / math.pi, "radians; these look like degrees"),
    ],
)
def test_envelope_hints_at_wrong_units(columns: list[int], factor: float, hint: str) -> None:
    path = good_path()
    path[:, columns] *= factor
    with pytest.raises(EnvelopeViolation, match=hint):
        BRUSH.check_path(path)


def test_envelope_gives_no_hint_for_other_errors() -> None:
    path = good_path()
    path[:, 1] += 1e6
    with pytest.raises(EnvelopeViolation) as caught:
        BRUSH.check_path(path)
    assert "look like" not in str(caught.value)


def _standing_still(path: np.ndarray) -> None:
    path[10, 0] = path[9, 0]


def _too_deep(path: np.ndarray) -> None:
    path[7, 3] = -0.0052


def _too_fast(path: np.ndarray) -> None:
    path[:, 0] /= 2.5  # 0.06 m/s becomes 0.15


def _turning(path: np.ndarray) -> None:
    path[16:, 4] += 0.1  # within a step of about 17 ms: 6 rad/s


def _starting_late(path: np.ndarray) -> None:
    path[:, 0] += 5.0  # an unplanned wait with the tool down


def _starting_abruptly(path: np.ndarray) -> None:
    """Constant 0.06 m/s from a standstill: an acceleration of v / (dt / 2) at the first point."""
    path[:] = 0
    path[:, 0] = 0.025 * np.arange(len(path))
    path[:, 1], path[:, 2] = 0.1 + 0.06 * path[:, 0], 0.1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_standing_still, r"at point 10 is 0 s; .* at least 0\.001 s"),
        (_too_deep, r"press depth \(z\) at point 7 is -0.0052 m; .* -0.004 to 0.05 m"),
        (_too_fast, r"speed at point \d+ is 0.15\d* m/s; .* 0.12 m/s"),
        (_turning, r"yaw rate at point 15 is .* rad/s; .* 3\.14159 rad/s"),
        (_starting_late, r"time at point 0 is 5 s; .* 0 s, the stroke's start"),
        (_starting_abruptly, r"acceleration at point (0|31) is 4\.8\d* m/s²; .* 2.5 m/s²"),
    ],
)
def test_envelope_message_names_quantity_point_value_and_limit(
    change: Callable[[np.ndarray], None], message: str
) -> None:
    path = good_path()
    change(path)
    with pytest.raises(EnvelopeViolation, match=message):
        BRUSH.check_path(path)


@PROPERTY
@given(seed=st.integers(0, 2**31), count=st.integers(60, 400))
def test_envelope_accepts_paths_rounded_to_float32(seed: int, count: int) -> None:
    """At the shortest steps rounding alone makes up to 0.1 m/s²; a path at its limit stays accepted."""
    rng = np.random.default_rng(seed)
    tool = load_tool("round_brush")
    path = bent_stroke(tool, 0.05, rng.uniform(-0.3, 0.3), rng.uniform(-3, 3), 0.003, 0.12, count)
    tight = dataclasses.replace(
        BRUSH,
        max_acceleration_m_s2=float(tip_accelerations(path).max()),
        max_speed_m_s=0.12,
    )
    tight.check_path(path.astype(np.float32))


def test_envelope_rounding_allowance_hides_no_motion() -> None:
    """Steps as short as allowed far from the origin: 1 % above the speed limit is refused."""
    wide = dataclasses.replace(BRUSH, max_acceleration_m_s2=1e9)
    steps = 1000
    path = np.zeros((steps, 5))
    path[:, 0] = np.arange(steps) * MIN_STEP_S
    path[:, 1] = 0.3 - 0.12 * 1.01 * path[:, 0]
    path[:, 2] = 0.2
    with pytest.raises(EnvelopeViolation, match="speed"):
        wide.check_path(path)
    path[:, 1] = 0.3 - 0.12 * path[:, 0]
    wide.check_path(path)


@pytest.mark.parametrize(
    "bad",
    [
        np.zeros((1, 5)),
        np.zeros((0, 5)),
        np.zeros((4, 4)),
        np.zeros(5),
        np.zeros((2, 3, 5)),
        np.zeros((3, 5), dtype=complex),
        np.full((3, 5), "1"),
        np.zeros((3, 5), dtype=bool),
        np.full((3, 5), None),
        [[0, 0, 0, 0, 0], [1, 2]],
    ],
)
def test_envelope_rejects_what_is_not_a_path(bad: Any) -> None:
    with pytest.raises(EnvelopeViolation, match="path"):
        BRUSH.check_path(bad)


def test_envelope_id_depends_on_every_limit() -> None:
    assert envelope_for(load_tool("round_brush"), CANVAS_M).id == BRUSH.id
    ids = {BRUSH.id}
    for field in dataclasses.fields(SafetyEnvelope):
        ids.add(dataclasses.replace(BRUSH, **{field.name: getattr(BRUSH, field.name) + 1e-3}).id)
    assert len(ids) == 1 + len(dataclasses.fields(SafetyEnvelope))


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(SafetyEnvelope)])
def test_envelope_rejects_infinite_limits(field: str) -> None:
    for value in (math.nan, math.inf):
        with pytest.raises(ConfigError, match=field):
            dataclasses.replace(BRUSH, **{field: value})


def test_envelope_rejects_an_empty_workspace() -> None:
    with pytest.raises(ConfigError, match="empty"):
        dataclasses.replace(BRUSH, x_max_m=0.0)
    with pytest.raises(ConfigError, match="below zero"):
        dataclasses.replace(BRUSH, max_speed_m_s=-0.1)
