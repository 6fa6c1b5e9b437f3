from pathlib import Path

import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.robots.tools import _END_EFFECTORS, load_end_effector
from pentimento.studio.clay.world import load_clay_world

BALL = """
name = "ball"
kind = "push"
nominal_width = "19 mm"
opening = "0 mm"
travel = ["0 mm", "40 mm"]
depth = ["2 mm", "12 mm"]
speed = "20 mm/s"
speed_range = ["8 mm/s", "60 mm/s"]
retract_speed_range = ["10 mm/s", "120 mm/s"]
dwell_range = ["0 s", "4 s"]
"""


@pytest.mark.parametrize("name", sorted(file.stem for file in _END_EFFECTORS.glob("*.toml")))
def test_every_bundled_end_effector_stands_in_the_studio_s_rack_and_is_about_as_wide(name: str) -> None:
    found, true = load_end_effector(name), load_clay_world("clay_table").tools[name]
    assert found.name == name
    assert found.nominal_width_m == pytest.approx(2 * true.half_width_m, rel=0.1)
    assert (found.kind == "pinch") == (true.spread_m > 0)
    assert found.opening_m == pytest.approx(true.spread_m + 2 * true.half_length_m if true.spread_m else 0.0)


def test_units_are_read(tmp_path: Path) -> None:
    file = tmp_path / "ball.toml"
    file.write_text(BALL.replace('"19 mm"', '"1.9 cm"'))
    read = load_end_effector(file)
    assert read.nominal_width_m == pytest.approx(0.019)
    assert read.travel_m == (0.0, 0.04)
    assert read.speed_range_m_s == (0.008, 0.06)
    assert read.dwell_range_s == (0.0, 4.0)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('kind = "poke"', "one of .*push.*pinch"),
        ("nominal_width = 19", "with its unit"),
        ('nominal_width = "0 mm"', "above zero"),
        ('depth = ["12 mm", "2 mm"]', "minimum first"),
        ('depth = ["2 mm", "2 mm"]', "must rise"),
        ('travel = "40 mm"', "it must be a list"),
        ('speed = "90 mm/s"', "within speed_range"),
        ('speed = "90 mm"', "m/s"),
        ('dwell_range = ["-1 s", "4 s"]', "0 s or longer"),
        ('name = ""', "non-empty"),
        ('opening = "50 mm"', "opening is 0.05"),
        ('kind = "pinch"', "opening is 0.0"),
        ('colour = "red"', "unknown keys"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, line: str, words: str) -> None:
    file = tmp_path / "bad.toml"
    key = line.split(" ")[0]
    file.write_text("\n".join(x for x in BALL.splitlines() if not x.startswith(f"{key} =")) + f"\n{line}\n")
    with pytest.raises(ConfigError, match=words):
        load_end_effector(file)


def test_unknown_names_list_the_known(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="soft_pad"):
        load_end_effector("chisel")
    with pytest.raises(ConfigError, match="does not exist"):
        load_end_effector(tmp_path / "gone.toml")
    (tmp_path / "broken.toml").write_text("name = ")
    with pytest.raises(ConfigError, match="not valid TOML"):
        load_end_effector(tmp_path / "broken.toml")
