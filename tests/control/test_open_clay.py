"""Sculpting by a rig: what is refused before there is a folder, the rehearsal, and a run with a scanner on files."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import CalibrationError, ConfigError, EnvelopeViolation
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control import open_clay as module
from pentimento.control import run_sculpture
from pentimento.control.commission import ClayCommission, ClayGoal, read_clay_commission
from pentimento.control.open_clay import SCANNERS, clay_rig, narrowed, open_clay, scanner_of
from pentimento.control.person import Control, Progress
from pentimento.control.push_safety import push_envelope_for
from pentimento.control.run_sculpture import Ended, clay_commission_of
from pentimento.robots.calibration import Calibration, write_calibration
from pentimento.robots.driver import Push
from pentimento.robots.rig import load_rig
from pentimento.robots.scan_files import connect as folder_of
from pentimento.robots.tools import load_end_effector
from tests.bundle.tiny_bundle import write_tiny_bundle
from tests.control.clay_machine import CameraProgram, ClayMachine
from tests.control.sculpting_bundle import FACTS, PIXELS, add_clay
from tests.planning.pushes.clay import PressedClay
from tests.robots.machines import make_rig

BALL = load_end_effector("ball")
AREA_M = (0.2, 0.2)
RIG_FILE = """
name = "clay_bench"
driver = "press"
canvas = ["200 mm", "200 mm"]
[canvas_to_robot]
origin = ["300 mm", "100 mm", "20 mm"]
turn = ["0 deg", "0 deg", "-90 deg"]
[reach]
low = ["200 mm", "-350 mm", "{low}"]
high = ["520 mm", "250 mm", "200 mm"]
[travel]
height = "60 mm"
speed = "100 mm/s"
park = ["100 mm", "-60 mm"]
[scanner]
driver = "folder"
folder = "{scans}"
wait = "60 s"
holds = "heights"
[limits]
max_speed = "50 mm/s"
x_min = "5 mm"
"""
PUSH = Push("push", np.array([0.1, 0.1, 0.5, 0.03, 0.008]), 0.03, 0.02, 0.5, 0.05)


class EntryPoints(dict[str, Any]):
    """As importlib.metadata's: names, and values that are loaded."""

    @property
    def names(self) -> set[str]:
        return set(self)


class Entry:
    def __init__(self, value: object) -> None:
        self._value = value

    def load(self) -> object:
        return self._value


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    (tmp_path / "scans").mkdir()
    path = tmp_path / "bench.toml"
    path.write_text(RIG_FILE.format(low="25 mm", scans=tmp_path / "scans"), encoding="utf-8")
    return path


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """As in test_run_sculpture: the tests' model of clay in place of the bundle's graphs."""
    folder = add_clay(write_tiny_bundle(tmp_path / "bundle"))
    monkeypatch.setattr(run_sculpture, "clay_members", lambda *_: (PressedClay(window_m=np.array(FACTS.window_m)),))
    return folder


@pytest.fixture
def machine(rig_file: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ClayMachine]:
    """The rig's machine in this process, with a camera program beside it."""
    pressing = ClayMachine(load_rig(rig_file), PIXELS)
    groups = {
        SCANNERS: EntryPoints(folder=Entry(folder_of)),
        "pentimento.robots": EntryPoints(press=Entry(lambda _: pressing)),
    }

    def in_process(open_robot: Callable[..., Any], arguments: tuple[Any, ...], ask: Callable[[str], None]) -> Any:
        return open_robot(*arguments, ask)

    monkeypatch.setattr(module, "SculptingRobotProcess", in_process)
    for name in ("pentimento.control.open_clay", "pentimento.control.open_robot"):
        monkeypatch.setattr(f"{name}.entry_points", lambda group: groups[group])
    camera = CameraProgram(pressing, rig_file.parent / "scans")
    yield pressing
    camera.end()


def calibrated(rig_file: Path) -> Path:
    folder = rig_file.parent / "calibration"
    values = {"surface": [0.0, 0.0, 0.0]}
    write_calibration(folder, Calibration("touch", load_rig(rig_file).digest, time.time(), "0" * 64, 1e-5, values))
    return folder


def commissioned(bundle: Path, rig_file: Path, **changes: Any) -> ClayCommission:
    entries = {"actions": 2, "seed": 3, "robot": str(rig_file), "execute": True} | changes
    return clay_commission_of(bundle, "foam", ClayGoal("letter", "T"), **entries)


def test_rig_and_scanner_named_in_its_file_sculpt(
    bundle: Path, rig_file: Path, machine: ClayMachine, tmp_path: Path
) -> None:
    asked: list[str] = []
    commission = commissioned(bundle, rig_file)

    def run(resume: bool, control: Control) -> Any:
        return run_sculpture.run_sculpture(
            commission, tmp_path / "s", resume=resume, control=control, progress=Progress(),
            calibration=calibrated(rig_file), ask=asked.append,
        )  # fmt: skip

    stopping = Control()
    stopping.send("stop")
    with pytest.raises(Ended):
        run(False, stopping)
    assert machine.height_m.min() == 0.03 and (tmp_path / "s/preview.png").is_file()  # nothing was pushed yet
    machine._halted = False
    state = run(True, Control())
    assert read_clay_commission(tmp_path / "s") == commission
    assert len(state.progress.actions) == 2 and state.progress.values[-1] < state.progress.values[0]
    pushes = [way for way in machine.ways if way[:, 3].min() < 0.0299]
    along = [way for way in pushes if way[0, 3] < 0.0301 and way[-1, 3] < way[0, 3]]
    for way, action in zip(along, state.progress.actions, strict=True):
        ends = action[:2] + np.outer([0.0, action[3]], [np.cos(action[2]), np.sin(action[2])])
        np.testing.assert_allclose(way[[0, -1], 1:3], ends, atol=1e-6)
        assert way[0, 3] - way[-1, 3] == pytest.approx(action[4], abs=1e-6)
    rows = read_table(tmp_path / "s/pushes", CONTRACT)
    assert rows.table.num_rows == 2 and not rows.quarantined
    assert set(rows.table["session"].to_pylist()) == {"sculpture-foam-3-2"}
    assert all(words.startswith("Fit the ball") for words in asked) and asked
    assert not (tmp_path / "s/journal.jsonl").exists()


def test_without_execute_the_studio_rehearses_and_refuses_what_the_rig_does_not_reach(
    bundle: Path, rig_file: Path, machine: ClayMachine, tmp_path: Path
) -> None:
    state = run_sculpture.run_sculpture(
        commissioned(bundle, rig_file, actions=1, execute=False), tmp_path / "s", resume=False, control=Control(),
        progress=Progress(),
    )  # fmt: skip
    assert len(state.progress.actions) == 1 and (tmp_path / "s/journal.jsonl").is_file()
    high = rig_file.with_name("high.toml")
    high.write_text(RIG_FILE.format(low="45 mm", scans="."), encoding="utf-8")  # 25 mm above the table
    opened = open_clay(
        load_rig(high), BALL, world="foam", scan_pixels=PIXELS, seed=1, journal=tmp_path / "j", execute=False,
        calibration=tmp_path, ask=lambda _: None, feeder=None,
    )  # fmt: skip
    opened.robot.change_tool(BALL)
    with pytest.raises(EnvelopeViolation, match="out of the reach"):
        opened.robot.push(PUSH)
    assert opened.robot.stopped is None and opened.in_studio
    opened.robot.push(replace(PUSH, action=PUSH.action * [1, 1, 1, 1, 0.25]))
    with pytest.raises(EnvelopeViolation, match=r"retract speed is 0\.06"):
        opened.robot.push(replace(PUSH, retract_speed_m_s=0.06))
    opened.close()


def test_hardware_needs_a_fresh_touch_calibration(
    bundle: Path, rig_file: Path, machine: ClayMachine, tmp_path: Path
) -> None:
    with pytest.raises(CalibrationError, match="no touch calibration"):
        run_sculpture.run_sculpture(
            commissioned(bundle, rig_file), tmp_path / "s", resume=False, control=Control(), progress=Progress(),
            calibration=tmp_path / "none", ask=lambda _: None,
        )  # fmt: skip


def test_rigs_that_cannot_sculpt_this_are_refused(rig_file: Path) -> None:
    assert clay_rig("virtual", AREA_M, has_feeder=True, execute=False) is None
    rig = clay_rig(str(rig_file), AREA_M, has_feeder=False, execute=True)
    assert rig is not None and rig.scanner["driver"] == "folder"
    for name, area_m, feeder, execute, words in (
        ("virtual", AREA_M, False, True, "needs no --execute"),
        ("nowhere", AREA_M, False, True, "There is no rig named"),
        (str(rig_file), (0.2, 0.1), False, False, "canvas of 0.2 by 0.2 m, and the push model is of a slab"),
        (str(rig_file), AREA_M, True, False, "has no feeder"),
        ("xarm", (0.3, 0.2), False, False, "has no scanner"),
    ):
        with pytest.raises(ConfigError, match=words):
            clay_rig(name, area_m, has_feeder=feeder, execute=execute)


def test_scanner_needs_a_park_and_an_installed_driver(rig_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "entry_points", lambda group: EntryPoints())
    with pytest.raises(ConfigError, match="names the scanner 'folder', and installed are"):
        scanner_of(load_rig(rig_file), 64)
    text = rig_file.read_text(encoding="utf-8")
    rig_file.write_text(text.replace('park = ["100 mm", "-60 mm"]\n', ""), encoding="utf-8")
    with pytest.raises(ConfigError, match="needs park"):
        load_rig(rig_file)
    rig_file.write_text(text.replace('driver = "folder"\n', ""), encoding="utf-8")
    with pytest.raises(ConfigError, match="needs driver"):
        load_rig(rig_file)


def test_scanner_gets_the_shape_of_the_slab(monkeypatch: pytest.MonkeyPatch) -> None:
    shapes: list[tuple[int, int]] = []
    monkeypatch.setattr(
        module, "entry_points", lambda group: EntryPoints(mine=Entry(lambda rig, shape: shapes.append(shape)))
    )
    scanner_of(make_rig(scanner={"driver": "mine"}), 96)
    assert shapes == [(64, 96)]


def test_limits_of_a_rig_narrow_and_never_widen() -> None:
    envelope = push_envelope_for(BALL, AREA_M)
    narrow = narrowed(envelope, {"x_min_m": 0.01, "x_max_m": 0.5, "max_speed_m_s": 0.03, "max_press_depth_m": 1.0})
    assert (narrow.x_min_m, narrow.x_max_m, narrow.max_depth_m) == (0.01, 0.2, envelope.max_depth_m)
    assert (narrow.max_speed_m_s, narrow.max_retract_speed_m_s) == (0.03, 0.03)
    assert narrowed(envelope, {}) == envelope


def test_rehearsal_refuses_an_unknown_driver_and_leaves_nothing(bundle: Path, rig_file: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="names the driver 'press', and installed are"):
        run_sculpture.run_sculpture(
            commissioned(bundle, rig_file, execute=False), tmp_path / "s", resume=False, control=Control(),
            progress=Progress(),
        )  # fmt: skip
    assert not (tmp_path / "s").exists()
