"""Executing strokes: dips, wipes, memory, and the state after an error."""

from typing import Any

import numpy as np
import pytest

from pentimento.contracts.covariates import Memory, fresh_memory
from pentimento.contracts.errors import ContractError, EnvelopeViolation
from pentimento.contracts.observations import Photo
from pentimento.contracts.plan import PlannedStroke
from pentimento.control.execute import ExecutionError, Session, execute, execute_stroke
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.driver import MissingAbilityError
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import Tool, load_tool

CANVAS_M = (0.3, 0.2)
RED, BLUE = np.array([0.8, 0.1, 0.1]), np.array([0.1, 0.1, 0.8])
PALETTE = np.array([RED, BLUE])
SESSION = Session(name="s", started_s=100.0)
DIP_S, WIPE_S, TRAVEL_S = 5.0, 3.0, 1.0


class FakeRobot:
    """Records every call with its clock, which dips, wipes, travel and strokes advance."""

    canvas_size_m = CANVAS_M

    def __init__(self, breaks_at: int | None = None) -> None:
        self.calls: list[str] = []
        self.clock_s = SESSION.started_s
        self.moves = 0
        self.breaks_at = breaks_at

    def change_tool(self, tool: Tool) -> None:
        self.calls.append(f"tool {tool.name}")

    def load_palette(self, colors_srgb: np.ndarray) -> None:
        self.calls.append(f"palette {len(colors_srgb)}")

    def dip(self, paint: int) -> None:
        self.calls.append(f"dip {paint}")
        self.clock_s += DIP_S

    def wipe(self) -> None:
        self.calls.append("wipe")
        self.clock_s += WIPE_S

    def move(self, path: np.ndarray) -> np.ndarray:
        if self.moves == self.breaks_at:
            raise RuntimeError("the arm's joint 3 is hot.")
        self.moves += 1
        self.calls.append("move")
        self.clock_s += TRAVEL_S + path[-1, 0]
        return path + 1e-4

    def force_n(self) -> np.ndarray:
        return np.zeros(0)

    def photo(self) -> Photo:
        raise MissingAbilityError("none")

    def scan(self) -> Any:
        raise MissingAbilityError("none")

    def new_sheet(self) -> None:
        self.calls.append("new_sheet")

    def wait(self, seconds: float) -> None:
        self.clock_s += seconds


def planned(color: np.ndarray = RED, dip: bool = False, y_m: float = 0.1, press_m: float = 0.001) -> PlannedStroke:
    xyz_yaw = np.zeros((16, 4))
    xyz_yaw[:, 0] = np.linspace(0.1, 0.13, 16)
    xyz_yaw[:, 1], xyz_yaw[:, 2] = y_m, -press_m
    return PlannedStroke(path=timed_path(xyz_yaw, 0.06), color_srgb=color, dip=dip)


def run(
    strokes: list[PlannedStroke], tool: str = "round_brush", memory: Memory | None = None
) -> tuple[Memory, list[str]]:
    robot = FakeRobot()
    memory, measured = execute(
        robot, load_tool(tool), strokes, palette_srgb=PALETTE, memory=memory or fresh_memory(CANVAS_M), session=SESSION
    )
    assert len(measured) == len(strokes)
    for path, stroke in zip(measured, strokes, strict=True):
        assert path == pytest.approx(stroke.path + 1e-4)
    return memory, robot.calls


def test_execute_first_stroke_dips_without_wiping() -> None:
    _, calls = run([planned(BLUE)])
    assert calls == ["tool round_brush", "palette 2", "wipe", "dip 1", "move"]


def test_execute_colour_change_wipes_then_dips() -> None:
    _, calls = run([planned(RED), planned(RED), planned(BLUE), planned(RED)])
    assert calls[2:] == ["wipe", "dip 0", "move", "move", "wipe", "dip 1", "move", "wipe", "dip 0", "move"]


def test_execute_dips_again_after_strokes_per_dip() -> None:
    _, calls = run([planned() for _ in range(9)])
    assert calls[3:] == ["dip 0", *["move"] * 4, "dip 0", *["move"] * 4, "dip 0", "move"]


def test_execute_requested_dip_restarts_the_count() -> None:
    _, calls = run([planned(), planned(dip=True), *[planned() for _ in range(4)]])
    assert calls[3:] == ["dip 0", "move", "dip 0", *["move"] * 4, "dip 0", "move"]


def test_execute_never_dips_a_marker() -> None:
    black = np.zeros(3)
    memory, calls = run([planned(black, dip=True), *[planned(black) for _ in range(8)]], tool="marker")
    assert calls == ["tool marker", *["move"] * 9]
    assert memory.reload_id == 0 and memory.since_reload == 9


def test_execute_memory_continues_between_calls() -> None:
    """Three strokes, then three more: one dip at the first and one after the fourth."""
    memory, first = run([planned() for _ in range(3)])
    memory, second = run([planned() for _ in range(3)], memory=memory)
    assert [call for call in first + second if call.startswith(("dip", "wipe"))] == ["wipe", "dip 0", "dip 0"]
    assert second[2:] == ["move", "dip 0", "move", "move"]


def test_execute_memory_advances_once_per_stroke() -> None:
    memory, _ = run([planned(y_m=0.05 + 0.01 * i) for i in range(6)])
    assert memory.tool_age_m == pytest.approx(6 * 0.03)
    assert memory.reload_id == 2 and memory.since_reload == 2
    assert memory.ink_since_reload_m == pytest.approx(2 * 0.03)
    assert memory.last_color_srgb == pytest.approx(RED)


def test_executed_stroke_has_start_time_and_covariates() -> None:
    """t_start counts from the session's start and follows wipe, dip and travel."""
    robot, tool, memory = FakeRobot(), load_tool("round_brush"), fresh_memory(CANVAS_M)
    memory, first = execute_stroke(robot, tool, planned(), palette_srgb=PALETTE, memory=memory, session=SESSION)
    memory, second = execute_stroke(robot, tool, planned(), palette_srgb=PALETTE, memory=memory, session=SESSION)
    assert first.event.dip and not second.event.dip
    assert first.event.t_start_s == pytest.approx(WIPE_S + DIP_S + TRAVEL_S)
    duration_s = float(planned().path[-1, 0])
    assert second.event.t_start_s == pytest.approx(WIPE_S + DIP_S + 2 * TRAVEL_S + duration_s)
    assert first.covariates["since_reload"] == 0 and second.covariates["since_reload"] == 1
    assert np.isnan(first.covariates["wet_age_s"])
    assert second.covariates["wet_age_s"] == pytest.approx(TRAVEL_S + duration_s, abs=duration_s)
    assert second.covariates["ink_since_reload_m"] == pytest.approx(0.03)


def test_execution_error_names_stroke_memory_and_paths() -> None:
    strokes = [planned(y_m=0.05 + 0.01 * i) for i in range(6)]
    robot = FakeRobot(breaks_at=3)
    with pytest.raises(ExecutionError, match=r"Stroke 3 of 6 failed: the arm's joint 3 is hot\.") as caught:
        execute(
            robot,
            load_tool("round_brush"),
            strokes,
            palette_srgb=PALETTE,
            memory=fresh_memory(CANVAS_M),
            session=SESSION,
        )
    error = caught.value
    assert isinstance(error.__cause__, RuntimeError)
    assert error.stroke == 3 and len(error.measured) == 3
    assert error.memory.since_reload == 3 and error.memory.tool_age_m == pytest.approx(0.09)


def test_execution_continues_from_the_errors_memory() -> None:
    """The tool was wiped and dipped for the failed stroke; continuing wipes and dips again."""
    strokes = [planned(RED), planned(BLUE), planned(BLUE)]
    robot = FakeRobot(breaks_at=1)
    with pytest.raises(ExecutionError) as caught:
        execute(
            robot,
            load_tool("round_brush"),
            strokes,
            palette_srgb=PALETTE,
            memory=fresh_memory(CANVAS_M),
            session=SESSION,
        )
    rest = strokes[caught.value.stroke :]
    memory, calls = run(rest, memory=caught.value.memory)
    assert calls[2:] == ["wipe", "dip 1", "move", "move"]
    whole, _ = run(strokes)
    assert (memory.reload_id, memory.since_reload) == (whole.reload_id, whole.since_reload)


def test_execute_stops_at_a_stroke_outside_the_envelope() -> None:
    tool = load_tool("round_brush")
    fake = FakeRobot()
    robot = GuardedRobot(fake, envelope_for(tool, CANVAS_M))
    strokes = [planned(), planned(press_m=0.006), planned()]
    with pytest.raises(ExecutionError, match=r"Stroke 1 of 3 failed: .*press depth .* -0.006 m") as caught:
        execute(robot, tool, strokes, palette_srgb=PALETTE, memory=fresh_memory(CANVAS_M), session=SESSION)
    assert isinstance(caught.value.__cause__, EnvelopeViolation)
    assert fake.moves == 1


def test_execute_rejects_unknown_colour_before_moving() -> None:
    robot = FakeRobot()
    with pytest.raises(ContractError, match=r"Stroke 1's colour \[0.5, 0.5, 0.5\] is not on the palette"):
        execute(
            robot,
            load_tool("flat_brush"),
            [planned(), planned(np.full(3, 0.5))],
            palette_srgb=PALETTE,
            memory=fresh_memory(CANVAS_M),
            session=SESSION,
        )
    with pytest.raises(ContractError, match="not the marker's own"):
        execute(
            robot,
            load_tool("marker"),
            [planned(RED)],
            palette_srgb=PALETTE,
            memory=fresh_memory(CANVAS_M),
            session=SESSION,
        )
    assert robot.calls == []


def test_execute_finds_colours_rounded_to_float32() -> None:
    _, calls = run([planned(BLUE.astype(np.float32).astype(np.float64))])
    assert "dip 1" in calls
