"""The driver in docs/writing_a_driver.md, as it stands there, on a device that is not there."""

import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.robots.hardware import HardwareRobot
from pentimento.robots.machine import MachineError, positions_only
from pentimento.robots.motion import timed_path
from pentimento.robots.rig import load_rig
from pentimento.robots.tools import load_tool
from pipelines._imports import ROOT
from tests.robots.machines import make_rig

PAGE = (ROOT / "docs/writing_a_driver.md").read_text()
RIG = make_rig(palette=None, machine={"address": "here"})


class Device:
    """Centimetres. It refuses call number `refuses`, and ignores all calls while `stuck`."""

    def __init__(self) -> None:
        self.at, self.went, self.refuses, self.frozen, self.stuck = (35.0, 15.0, 8.0), [], -1, 0, False

    def place(self) -> tuple[float, float, float]:
        return self.at

    def go(self, x: float, y: float, z: float, seconds: float) -> bool:
        self.went.append((x, y, z, seconds))
        if len(self.went) == self.refuses:
            return False
        if not self.stuck:
            self.at = (x, y, z)
        return True

    def freeze(self) -> None:
        self.frozen += 1

    def close(self) -> None: ...


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> tuple[types.ModuleType, Device]:
    device = Device()
    package = types.ModuleType("doodle")
    package.open = lambda address: device  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "doodle", package)
    found = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert found
    module = types.ModuleType("my_package.doodle")
    exec(compile(found[1], "docs/writing_a_driver.md", "exec"), module.__dict__)
    return module, device


def test_example_driver_paints_lifts_and_rejects_bad_commands(driver: tuple[types.ModuleType, Device]) -> None:
    module, device = driver
    tool = load_tool("marker")
    guard = GuardedRobot(HardwareRobot(module.connect(RIG), RIG, lambda _: None), envelope_for(tool, (0.3, 0.2)))
    guard.change_tool(tool)
    s = np.linspace(0, 1, 8)
    path = timed_path(np.column_stack((0.1 + 0.02 * s, 0.1 + 0 * s, 0 * s, 0 * s)), 0.06)
    guard.move(path)
    low = np.array([place for place in device.went if place[2] < 5.0 + 1e-6])
    # canvas (x, y, z) -> robot (0.4 − y, 0.1 + x, 0.05 + z), in centimetres
    assert low[:, 0] == pytest.approx(np.full(len(low), 30.0)) and low[-1, 1] == pytest.approx(22.0)
    assert device.at[2] == pytest.approx(8.0)
    device.refuses = len(device.went) + 70
    with pytest.raises(MachineError, match="refused a place"):
        guard.move(path)
    assert device.frozen and device.at[2] == pytest.approx(8.0) and guard.stopped is not None


def test_example_driver_checks_where_a_motion_starts_and_ends(driver: tuple[types.ModuleType, Device]) -> None:
    module, device = driver
    machine, times_s = module.connect(RIG), np.array([0.0, 1.0])
    here_m = np.array(device.at) / 100
    moved_m = here_m + np.array([0.02, 0.0, 0.0])
    with pytest.raises(MachineError, match=r"20\.0 mm .* from where the next motion begins"):
        machine.follow(times_s, positions_only(np.stack([moved_m, here_m])))
    assert device.went == []
    device.stuck = True
    with pytest.raises(MachineError, match=r"stopped 20\.0 mm from its target"):
        machine.follow(times_s, positions_only(np.stack([here_m, moved_m])))


def test_without_its_package_it_says_what_to_install(
    driver: tuple[types.ModuleType, Device], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "doodle", None)
    with pytest.raises(ConfigError, match="pip install doodle"):
        driver[0].connect(RIG)


def test_example_rig_file_is_complete_and_opens_the_example_driver(
    driver: tuple[types.ModuleType, Device], tmp_path: Path
) -> None:
    module, device = driver
    found = re.search(r'```toml\n(name = "doodle".*?)```', PAGE, re.DOTALL)
    assert found
    (tmp_path / "doodle.toml").write_text(found[1])
    rig = load_rig(tmp_path / "doodle.toml")
    assert rig.driver == "doodle" and rig.camera is None
    place_m = module.connect(rig).where()[:3, 3]
    assert place_m == pytest.approx(np.array(device.at) / 100)


def test_example_scanner_makes_heights_of_a_depth_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slab 40 mm high under a camera 600 mm above the table: millimetres, 0 = hole."""
    depth_mm = np.full((300, 300), 560.0)
    depth_mm[:20] = 0.0
    opened: list[str] = []
    device = types.SimpleNamespace(
        depth_millimetres=depth_mm.copy, focal=lambda: (600.0, 600.0), centre=lambda: (149.5, 149.5),
        close=lambda: opened.append("closed"),
    )  # fmt: skip
    package = types.ModuleType("peek")
    package.open = lambda serial: opened.append(serial) or device  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "peek", package)
    found = re.search(r'```python\n("""The Peek.*?)```', PAGE, re.DOTALL)
    assert found
    module = types.ModuleType("my_package.peek")
    exec(compile(found[1], "docs/writing_a_driver.md", "exec"), module.__dict__)
    rig = make_rig(canvas_size_m=(0.2, 0.2), scanner={"driver": "peek", "serial": "7"})
    scanner = module.connect(rig, (50, 50))
    scan = scanner.scan()
    scanner.close()
    assert opened == ["7", "closed"] and scan.height_m.shape == (50, 50)
    assert np.nanmax(np.abs(scan.height_m - 0.04)) < 1e-12
    with pytest.raises(ConfigError, match=r"\[scanner\] of rig bench: missing keys \['serial'\]"):
        module.connect(make_rig(scanner={"driver": "peek"}), (50, 50))
