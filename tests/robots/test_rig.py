"""Rig files: what is bundled, and what is refused."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.control.safety import SafetyEnvelope
from pentimento.robots.rig import _LIMITS, load_rig, rotation_of

PLOTTER = """
name = "mine"
driver = "grbl"
canvas = ["300 mm", "20 cm"]
[canvas_to_robot]
origin = ["20 mm", "20 mm", "-10 mm"]
turn = ["0 deg", "0 deg", "90 deg"]
[reach]
low = ["-400 mm", "0 mm", "-14 mm"]
high = ["380 mm", "380 mm", "0 mm"]
[travel]
height = "5 mm"
speed = "80 mm/s"
[machine]
port = "/dev/ttyUSB0"
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    return path


def test_a_rig_is_in_si_units(tmp_path: Path) -> None:
    rig = load_rig(written(tmp_path, PLOTTER))
    assert rig.canvas_size_m == pytest.approx((0.3, 0.2)) and rig.travel_speed_m_s == pytest.approx(0.08)
    assert rig.turn_rad == pytest.approx((0, 0, np.pi / 2)) and rig.machine == {"port": "/dev/ttyUSB0"}
    assert rig.canvas_to_robot @ [0.1, 0, 0, 1] == pytest.approx([0.02, 0.12, -0.01, 1])
    assert rig.palette is None and rig.camera is None


@pytest.mark.parametrize("name", ["plotter", "plotter_on_file", "xarm", "franka"])
def test_bundled_rigs_can_be_read(name: str) -> None:
    rig = load_rig(name)
    assert rig.name == name and rig.digest != load_rig("plotter" if name != "plotter" else "xarm").digest


def test_limits_of_a_rig_are_fields_of_the_envelope(tmp_path: Path) -> None:
    lines = [f'{name} = "1 {unit}"' for name, unit in _LIMITS.items()]
    rig = load_rig(written(tmp_path, PLOTTER + "[limits]\n" + "\n".join(lines)))
    assert set(rig.limits) == {field.name for field in dataclasses.fields(SafetyEnvelope)}
    assert set(rig.limits.values()) == {1.0} and load_rig("plotter").limits == {}


def test_the_digest_follows_every_change_of_the_file(tmp_path: Path) -> None:
    one = load_rig(written(tmp_path, PLOTTER)).digest
    assert load_rig(written(tmp_path, PLOTTER.replace("-10 mm", "-10.1 mm"))).digest != one


def test_rotations_are_about_fixed_axes() -> None:
    """A quarter about x takes z to −y; then a quarter about z takes −y to x."""
    assert rotation_of(np.pi / 2, 0, np.pi / 2) @ [0, 0, 1] == pytest.approx([1, 0, 0], abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('name = "mine"', "", r"missing keys \['name'\]"),
        ('name = "mine"', 'name = "mine"\ncolour = 1', r"unknown keys \['colour'\]"),
        ('"300 mm"', '"300"', "no unit"),
        ('"300 mm"', '"300 s"', "is a time"),
        ('"300 mm"', "300", "with its unit"),
        ('"80 mm/s"', '"80 mm"', "per time"),
        ('"5 mm"', '"0 mm"', "above zero"),
        ('high = ["380 mm"', 'high = ["-500 mm"', "below reach.high"),
        ('"380 mm", "0 mm"]', '"300 mm", "0 mm"]', "out of its reach"),
        ("[machine]", "camera = true\n[machine]", "unknown keys"),
        ('name = "mine"', 'name = "mine"\ncamera = 0', r"needs park, a place outside the canvas"),
        ('speed = "80 mm/s"', 'speed = "80 mm/s"\npark = ["-1 m", "0 m"]', "parking place, .* out of its reach"),
        ('name = "mine"', 'name = "mine"\ncamera = true', "camera is True; it must be a whole number"),
        (
            "[machine]",
            '[palette]\nwells = [["10 mm", "10 mm"]]\nwater = ["9 m", "0 m"]\ncloth = ["9 m", "0 m"]\n'
            'depth = "1 mm"\n[machine]',
            "lies on the canvas",
        ),
        ('name = "mine"', "name = mine", "not valid TOML"),
        ("[machine]", '[limits]\nmax_force = "1 N"\n[machine]', r"unknown keys \['max_force'\]"),
        ("[machine]", '[limits]\nmax_speed = "50 mm"\n[machine]', "max_speed in .* per time"),
    ],
)
def test_a_bad_rig_is_refused_with_a_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in PLOTTER
    with pytest.raises(ConfigError, match=sentence):
        load_rig(written(tmp_path, PLOTTER.replace(old, new, 1)))


def test_an_unknown_rig_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="choose one of"):
        load_rig("nothing")
    with pytest.raises(ConfigError, match="does not exist"):
        load_rig(tmp_path / "none.toml")
