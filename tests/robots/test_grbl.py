"""The streaming plotter against a simulated GRBL on a pseudo-terminal, with everything that can go wrong on a cable."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.control.guard import GuardedRobot, LiftError, StoppedError
from pentimento.control.safety import envelope_for
from pentimento.robots.grbl import connect
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.machine import HaltedError, MachineError
from pentimento.robots.motion import timed_path
from pentimento.robots.rig import Rig
from pentimento.robots.simulated_grbl import Faults, SimulatedGrbl, svg_of
from pentimento.robots.tools import load_tool
from tests.robots.machines import in_thread, make_rig

CANVAS_M = (0.3, 0.2)
PAPER_MM, UP_MM = -10.0, -5.0
TO_THE_STROKE = 2 * 33  # lines across and down: 32 pieces and a dwell each
MARKER = load_tool("marker")


def plotter_rig(port: str, **pen: object) -> Rig:
    return make_rig(
        name="plotter",
        driver="grbl",
        origin_m=(0.02, 0.02, -0.01),
        turn_rad=(0.0, 0.0, 0.0),
        reach_m=((0.0, 0.0, -0.014), (0.38, 0.28, 0.0)),
        travel_height_m=0.005,
        palette=None,
        machine={"port": port, "baud": 115200, **(pen or {"pen": "z"})},
    )


@contextmanager
def plotting(
    faults: Faults | None = None, hurry: float = 200.0, pen: dict[str, object] | None = None, **simulation: object
) -> Iterator[tuple[SimulatedGrbl, GuardedRobot, HardwareRobot]]:
    grbl = SimulatedGrbl(faults, hurry, **simulation)  # type: ignore[arg-type]
    try:
        rig = plotter_rig(grbl.port, **(pen or {}))
        robot = HardwareRobot(connect(rig), rig, lambda _: None)
        guard = GuardedRobot(robot, envelope_for(MARKER, CANVAS_M))
        guard.change_tool(MARKER)
        yield grbl, guard, robot
    finally:
        grbl.close()


def stroke(length_m: float = 0.04, points: int = 12, speed_m_s: float = 0.06) -> np.ndarray:
    s = np.linspace(0, 1, points)
    return timed_path(np.column_stack((0.1 + length_m * s, 0.1 + 0.01 * s, -5e-4 + 0 * s, 0 * s)), speed_m_s)


def drawn(trace: list[tuple[float, float, float, int]]) -> np.ndarray:
    """Places [N, 2] in millimetres where the pen was on the paper."""
    return np.array([[x, y] for x, y, z, _ in trace if z < PAPER_MM + 1e-6])


def test_a_stroke_is_drawn_where_it_was_planned_in_millimetres() -> None:
    path = stroke()
    with plotting() as (grbl, guard, _):
        measured = guard.move(path)
        trace = list(grbl.trace)
        assert grbl.place_mm[2] == pytest.approx(UP_MM, abs=1e-3)
    assert np.isnan(measured).all()
    seen = drawn(trace)
    for x_m, y_m in path[:, 1:3]:
        assert np.abs(seen - [20 + 1000 * x_m, 20 + 1000 * y_m]).max(axis=1).min() < 2e-3
    sideways_low = [(a, b) for a, b in pairwise(trace) if a[:2] != b[:2] and max(a[2], b[2]) < UP_MM - 1e-3]
    assert len(sideways_low) == len(path) - 1  # the stroke alone moves sideways below travel height


def test_the_stroke_takes_the_time_that_was_planned() -> None:
    path = stroke(0.05)
    with plotting(hurry=1.0) as (_, guard, robot):
        guard.lift()
        robot._travel(np.array([[0, 0.1, 0.1, 0.005, 0], [0.1, 0.1 + 1e-5, 0.1, 0.005, 0]]), "approach")
        begun_s = time.perf_counter()
        robot._machine.follow(path[:, 0], _poses(path, robot))
        took_s = time.perf_counter() - begun_s
    planned_s = path[-1, 0] + _first_leg_s(path)
    assert 0.95 * planned_s < took_s < 1.2 * planned_s + 0.3


def _poses(path: np.ndarray, robot: HardwareRobot) -> np.ndarray:
    from pentimento.robots.journey import poses_of

    return poses_of(path, robot.rig)


def _first_leg_s(path: np.ndarray) -> float:
    """The simulated pen stands 5.5 mm above the stroke's start and takes the first line's feed for that way, too."""
    first_m = np.linalg.norm(path[1, 1:4] - path[0, 1:4])
    start = np.array([0.1 + 1e-5, 0.1, 0.005])
    return float(np.linalg.norm(path[1, 1:4] - start) - first_m) / float(first_m / path[1, 0])


def test_work_coordinates_apart_from_the_machine_s_are_understood() -> None:
    with plotting(offset_mm=(-200.0, -30.0, 4.0)) as (grbl, guard, robot):
        guard.move(stroke())
        assert robot._machine.where()[:3, 3] * 1000 == pytest.approx(grbl.place_mm, abs=2e-3)
        assert grbl.place_mm[0] == pytest.approx(160, abs=2e-3)


def test_a_servo_pen_draws_and_rises() -> None:
    pen = {"pen": "servo", "servo_up": 30, "servo_down": 60}
    with plotting(pen=pen) as (grbl, guard, _):
        guard.move(stroke())
        trace = list(grbl.trace)
    low = np.array([[x, y] for x, y, _, s in trace if s == 60])
    assert low[:, 0].min() == pytest.approx(120, abs=2e-3) and low[:, 0].max() == pytest.approx(160, abs=2e-3)
    assert trace[-1][3] == 30 and all(z == 0 for _, _, z, _ in trace)


def test_a_servo_pen_stays_up_at_the_end() -> None:
    pen = {"pen": "servo", "servo_up": 30, "servo_down": 60}
    with plotting(pen=pen) as (grbl, guard, robot):
        guard.move(stroke())
        robot.close()
        assert grbl.trace[-1][3] == 30
        assert "M5" not in grbl.lines  # it would take the servo to 0


@pytest.mark.parametrize(("up", "down"), [(60, 30), (30, 30)])
def test_a_servo_that_a_reset_would_press_on_the_paper_is_refused(up: int, down: int) -> None:
    grbl = SimulatedGrbl()
    try:
        with pytest.raises(ConfigError, match=f"servo_up is {up} and servo_down {down}.*smaller"):
            connect(plotter_rig(grbl.port, pen="servo", servo_up=up, servo_down=down))
        assert not grbl.lines and {s for *_, s in grbl.trace} <= {0}
    finally:
        grbl.close()


@contextmanager
def resetting(**simulation: object) -> Iterator[tuple[SimulatedGrbl, Rig]]:
    """A board that starts again when its port is opened, as an Arduino does."""
    grbl = SimulatedGrbl(hurry=200.0, boots_s=0.3, **simulation)  # type: ignore[arg-type]
    try:
        yield grbl, plotter_rig(grbl.port)
    finally:
        grbl.close()


def test_a_reset_at_opening_is_noticed_and_the_person_asked_to_put_the_pen_to_its_place() -> None:
    with resetting(offset_mm=(-200.0, -30.0, 4.0)) as (grbl, rig):
        asked: list[str] = []
        robot = HardwareRobot(connect(rig), rig, asked.append)
        with pytest.raises(MachineError, match=r"Nothing moved.*does not know where its pen is"):
            robot.move(stroke())
        assert not any(line.startswith("G1") for line in grbl.lines)
        robot.change_tool(MARKER)
        assert "by hand to [200.0, 30.0, -4.0] mm" in asked[0] and "Fit the marker" in asked[1]
        robot.move(stroke())
        robot.close()
        place_mm = grbl.place_mm
        again = HardwareRobot(connect(rig), rig, asked.append)  # the board ran on, so the place is still known
        again.change_tool(MARKER)
        assert grbl.starts == 1 and len(asked) == 3 and "Fit the marker" in asked[2]
        assert again._machine.where()[:3, 3] * 1000 == pytest.approx(place_mm, abs=2e-3)
        again.close()


def test_a_person_who_does_not_confirm_is_asked_again_at_the_next_opening() -> None:
    def nobody(request: str) -> None:
        raise EOFError(request)

    with resetting() as (grbl, rig):
        for starts in (1, 2):
            robot = HardwareRobot(connect(rig), rig, nobody)
            with pytest.raises(EOFError, match="was reset when its port was opened"):
                robot.change_tool(MARKER)
            robot._machine.close()
            time.sleep(0.1)
            assert grbl.starts == starts
        assert not any(line.startswith("G1") for line in grbl.lines)


def test_an_alarm_at_every_opening_is_homed_when_the_person_confirms() -> None:
    with resetting(settings={"22": "1"}) as (grbl, rig):
        asked: list[str] = []
        machine = connect(rig)
        robot = HardwareRobot(machine, rig, asked.append)
        assert "$H" not in grbl.lines and grbl._state == "Alarm"
        robot.change_tool(MARKER)
        assert "waits for its homing" in asked[0] and grbl.lines.count("$H") == 1
        robot.move(stroke())
        assert grbl.place_mm[0] == pytest.approx(160, abs=2e-3)
        robot.close()
        HardwareRobot(connect(rig), rig, asked.append).close()
        assert grbl.starts == 1 and grbl.lines.count("$H") == 1


def test_an_alarm_after_a_reset_without_homing_switches_is_refused() -> None:
    grbl = SimulatedGrbl(settings={"22": "1"}, boots_s=0.1)
    grbl._settings["22"], grbl._execute = "0", _alarmed(grbl)  # type: ignore[method-assign]
    try:
        with pytest.raises(MachineError, match="home or unlock it by hand"):
            connect(plotter_rig(grbl.port))
    finally:
        grbl.close()


def _alarmed(grbl: SimulatedGrbl) -> Callable[[str], str]:
    """Its executing of lines, in alarm."""
    execute = grbl._execute

    def run(line: str) -> str:
        grbl._state = "Alarm"
        return execute(line)

    return run


def test_slow_axes_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """The z axis makes 5 mm/s: 4 mm take 0.8 s, where 0.05 s were planned."""
    monkeypatch.setattr("pentimento.robots.grbl.ANSWER_S", 0.3)
    with plotting(hurry=1.0, settings={"110": "6000", "111": "6000", "112": "300"}) as (grbl, _, robot):
        poses = np.tile(np.eye(4), (2, 1, 1))
        poses[1, 2, 3] = -0.004
        robot._machine.follow(np.array([0.0, 0.05]), poses)
        assert grbl.place_mm[2] == pytest.approx(-4, abs=1e-3)


ERRORS = {
    "an error": lambda line: Faults(answers={line: "error:22"}),
    "an alarm": lambda line: Faults(answers={line: "ALARM:2"}),
    "a lost line": lambda line: Faults(lost=frozenset({line})),
    "a reset of its own": lambda line: Faults(answers={line: "Grbl 1.1h ['$' for help]"}),
    "a garbled number": lambda line: Faults(garbled={line: lambda text: text.replace("X", "Q", 1)}),
}


@pytest.mark.parametrize("fault", ERRORS)
def test_any_error_stops_the_stream_lifts_the_pen_and_latches(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pentimento.robots.grbl.ANSWER_S", 0.6)
    with plotting() as (grbl, guard, _):
        guard.move(stroke())
        grbl.faults = ERRORS[fault](len(grbl.lines) + TO_THE_STROKE + 6)
        begun_s = time.perf_counter()
        with pytest.raises(MachineError):
            guard.move(stroke())
        assert time.perf_counter() - begun_s < 6
        assert 120 <= grbl.place_mm[0] < 160
        assert grbl.place_mm[2] == pytest.approx(UP_MM, abs=1e-3)
        assert guard.stopped is not None
        sent = len(grbl.lines)
        with pytest.raises(StoppedError):
            guard.move(stroke())
        assert len(grbl.lines) == sent
        guard.release()
        guard.move(stroke())  # after a person has looked, it goes on
        assert grbl.place_mm[0] == pytest.approx(160, abs=2e-3)


def test_a_swallowed_line_at_a_stroke_s_end_is_noticed_by_the_place() -> None:
    with plotting() as (grbl, guard, _):
        guard.move(stroke())
        sent = len(grbl.lines)
        guard.move(stroke())
        ends = [i for i in range(sent, len(grbl.lines)) if grbl.lines[i].startswith("G4")]
        # The line before the dwell that ends each way carries it to its end.
        grbl.faults.swallowed = frozenset({len(grbl.lines) + ends[0] - sent - 1})
        with pytest.raises(MachineError, match=r"stands at .* and not at .* lost or garbled"):
            guard.move(stroke())


def test_slow_answers_are_no_error() -> None:
    with plotting(Faults(delay_s=0.01)) as (grbl, guard, _):
        guard.move(stroke())
        assert grbl.place_mm[0] == pytest.approx(160, abs=2e-3)


@pytest.mark.parametrize("pen", [{"pen": "z"}, {"pen": "servo", "servo_up": 30, "servo_down": 60}])
def test_a_stop_in_the_middle_of_a_stroke_lifts_the_pen_within_a_second(pen: dict[str, object]) -> None:
    """In real time: a stroke of 50 mm at 20 mm/s, stopped after half a second of it."""
    with plotting(hurry=1.0, pen=pen) as (grbl, guard, _):

        def on_paper() -> bool:
            return grbl.trace != [] and (
                grbl.trace[-1][3] == 60 if pen["pen"] == "servo" else grbl.place_mm[2] < PAPER_MM
            )

        with in_thread(lambda: guard.move(stroke(0.05, 32, 0.02))) as errors:
            deadline_s = time.monotonic() + 20
            while not on_paper():
                assert time.monotonic() < deadline_s and not errors
                time.sleep(0.01)
            time.sleep(0.5)
            begun_s = time.perf_counter()
            guard.stop("the person pressed stop")
            took_s = time.perf_counter() - begun_s
        stopped_at = grbl.place_mm
        assert 120 < stopped_at[0] < 165  # it had not gone to the stroke's end
        assert grbl.trace[-1][3] == 30 if pen["pen"] == "servo" else stopped_at[2] == pytest.approx(UP_MM, abs=1e-3)
        assert isinstance(errors[0], HaltedError)
        assert grbl._state == "Idle"  # no alarm: no step was lost
    assert took_s < 1.0


def test_lost_serial_link_error_says_that_the_pen_may_be_down() -> None:
    with plotting() as (grbl, guard, _):
        grbl.hang_up()
        with pytest.raises(LiftError, match=r"may still rest on the canvas.*emergency stop"):
            guard.move(stroke())
        assert guard.stopped is not None


def test_unanswered_line_raises_machine_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pentimento.robots.grbl.ANSWER_S", 0.2)
    monkeypatch.setattr("pentimento.robots.grbl.REST_S", 0.2)
    with plotting(Faults(silent_from=30)) as (_, guard, _), pytest.raises(LiftError, match="check the cable"):
        guard.move(stroke(points=40))


def test_a_soft_reset_in_motion_would_lose_steps() -> None:
    """The simulation punishes what the driver avoids: without a feed hold the reset leaves an alarm."""
    with plotting(hurry=1.0) as (grbl, _, robot):
        line = robot._machine._line  # type: ignore[attr-defined]
        line.send("G1 X100.000 Y0.000 Z0.000 F600.0")
        time.sleep(0.1)
        line.send_byte(b"\x18")
        time.sleep(0.1)
        assert grbl._state == "Alarm"


@pytest.mark.parametrize(
    ("simulation", "sentence"),
    [
        ({"settings": {"13": "1"}}, "must report millimetres"),
        ({"settings": {"32": "1"}}, "laser mode"),
        ({"version": "0.9j"}, "knows Grbl 1.1"),
    ],
)
def test_a_controller_that_would_misunderstand_is_refused(simulation: dict[str, object], sentence: str) -> None:
    with pytest.raises(MachineError, match=sentence), plotting(**simulation):  # type: ignore[arg-type]
        pass


def test_a_plotter_in_alarm_is_not_unlocked_by_a_program() -> None:
    grbl = SimulatedGrbl(hurry=200)
    try:
        grbl._state = "Alarm"
        with pytest.raises(MachineError, match="home or unlock it by hand"):
            connect(plotter_rig(grbl.port))
    finally:
        grbl.close()


def test_missing_or_non_serial_port_is_rejected(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MachineError, match="cannot be opened"):
        connect(plotter_rig(str(tmp_path / "none")))
    (tmp_path / "file").write_text("")
    with pytest.raises(MachineError, match="no serial port"):
        connect(plotter_rig(str(tmp_path / "file")))
    with pytest.raises(ConfigError, match="rate 1200 is not known"):
        connect(make_rig(machine={"port": "x", "baud": 1200, "pen": "z"}))


def test_a_trace_becomes_a_picture_of_what_touched_the_paper() -> None:
    with plotting() as (grbl, guard, _):
        guard.move(stroke())
        picture = svg_of(list(grbl.trace), PAPER_MM)
    assert picture.count("M") == len(stroke()) - 1
