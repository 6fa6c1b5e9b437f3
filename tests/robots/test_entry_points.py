"""Each declared driver is there, takes a rig, and says which keys its table has."""

import importlib
import tomllib

import pytest

from pentimento.contracts.errors import ConfigError
from pipelines._imports import ROOT
from tests.robots.machines import make_rig

ENTRY_POINTS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
DECLARED, SCANNERS = ENTRY_POINTS["pentimento.robots"], ENTRY_POINTS["pentimento.scanners"]


def test_the_drivers_of_this_project_are_declared() -> None:
    assert set(DECLARED) == {"gcode", "grbl", "xarm", "franka", "lerobot"}


@pytest.mark.parametrize("name", ["gcode", "grbl", "xarm", "franka", "lerobot"])
def test_a_driver_refuses_a_table_of_another_machine_before_it_connects(name: str) -> None:
    module, _, function = DECLARED[name].partition(":")
    with pytest.raises(ConfigError, match=r"\[machine\] of rig bench: .*unknown keys \['engine'\]"):
        getattr(importlib.import_module(module), function)(make_rig(machine={"engine": "steam"}))


def test_the_scanner_of_this_project_is_declared_and_names_what_its_table_lacks() -> None:
    assert set(SCANNERS) == {"folder"}
    module, _, function = SCANNERS["folder"].partition(":")
    with pytest.raises(ConfigError, match=r"\[scanner\] of rig bench: missing keys \['folder', 'holds', 'wait'\]"):
        getattr(importlib.import_module(module), function)(make_rig(scanner={"driver": "folder"}), (8, 8))
