"""Tool files: what is bundled, and what is refused."""

from pathlib import Path

import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.robots.tools import ball_m3, load_feeder, load_tool

MARKER = """
name = "marker"
medium = "ink"
kind = "marker"
nominal_width = "2 mm"
press_range = ["0 mm", "1 mm"]
stroke_length = ["5 mm", "50 mm"]
bend_range = [-0.35, 0.35]
speed = "60 mm/s"
speed_range = ["20 mm/s", "120 mm/s"]
strokes_per_dip = 0
color_srgb = [0.0, 0.0, 0.0]
"""


def test_bundled_tools_are_in_si_units() -> None:
    marker, round_brush, flat_brush = (load_tool(name) for name in ("marker", "round_brush", "flat_brush"))
    assert marker.press_range_m == pytest.approx((0.0, 0.001))
    assert round_brush.press_range_m == pytest.approx((0.0003, 0.004))
    assert flat_brush.press_range_m == pytest.approx((0.0003, 0.003))
    widths_m = [tool.nominal_width_m for tool in (marker, round_brush, flat_brush)]
    assert widths_m == pytest.approx([0.002, 0.007, 0.012])
    assert marker.stroke_length_m == pytest.approx((0.005, 0.05))
    assert round_brush.stroke_length_m == pytest.approx((0.008, 0.055))
    assert flat_brush.stroke_length_m == pytest.approx((0.01, 0.06))
    assert [tool.strokes_per_dip for tool in (marker, round_brush, flat_brush)] == [0, 4, 4]
    assert [tool.dips for tool in (marker, round_brush, flat_brush)] == [False, True, True]
    assert marker.color_srgb == (0, 0, 0) and round_brush.color_srgb is None
    for tool in (marker, round_brush, flat_brush):
        assert tool.speed_m_s == pytest.approx(0.06)
        assert tool.speed_range_m_s[0] < tool.speed_m_s < tool.speed_range_m_s[1]


def test_bundled_tool_is_named_as_its_file() -> None:
    for name in ("marker", "round_brush", "flat_brush"):
        assert load_tool(name).name == name


def test_a_tool_file_of_ones_own_is_read_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(MARKER.replace('"2 mm"', '"0.1 in"'))
    assert load_tool(path).nominal_width_m == pytest.approx(0.00254)
    assert load_tool(str(path)) == load_tool(path)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('speed = "60 mm/s"', "", r"missing keys \['speed'\]"),
        ('speed = "60 mm/s"', 'speed = "60 mm/s"\nspede = 1', r"unknown keys \['spede'\]"),
        ('"2 mm"', "0.002", "with its unit"),
        ('"2 mm"', '"2 furlongs"', "furlongs"),
        ('"2 mm"', '"2 s"', "nominal_width"),
        ('["0 mm", "1 mm"]', '["1 mm", "0 mm"]', "minimum first"),
        ('["0 mm", "1 mm"]', '["-1 mm", "1 mm"]', "press_range"),
        ('["0 mm", "1 mm"]', '["1 mm"]', "a list of 2"),
        ('"60 mm/s"', '"60 m/s"', "speed_range"),
        ("strokes_per_dip = 0", "strokes_per_dip = 2.5", "whole number"),
        ("strokes_per_dip = 0", "strokes_per_dip = true", "whole number"),
        ("color_srgb = [0.0, 0.0, 0.0]", "", "needs color_srgb"),
        ("[0.0, 0.0, 0.0]", "[0, 0, 255]", "0 to 1"),
        ("[0.0, 0.0, 0.0]", "[0, 0]", "a list of 3"),
        ("[-0.35, 0.35]", "[nan, 0.35]", "finite"),
        ('kind = "marker"', 'kind = "pen"', "one of"),
        ('name = "marker"', 'name = ""', "non-empty"),
        ('name = "marker"', "name = ", "not valid TOML"),
    ],
)
def test_a_bad_tool_file_is_refused_by_a_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in MARKER
    path = tmp_path / "bad.toml"
    path.write_text(MARKER.replace(old, new, 1))
    with pytest.raises(ConfigError, match=sentence):
        load_tool(path)


def test_an_unknown_name_says_which_tools_there_are(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"flat_brush.*marker.*round_brush"):
        load_tool("broom")
    with pytest.raises(ConfigError, match="does not exist"):
        load_tool(tmp_path / "none.toml")


def test_bundled_feeder_is_in_si_units_and_presses_by_diameter() -> None:
    feeder = load_feeder("pellets")
    assert feeder.volume_m3 == pytest.approx((ball_m3(0.006), ball_m3(0.014)))
    assert feeder.press_m(ball_m3(0.01)) == pytest.approx(feeder.pressed_share * 0.01)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ('diameter = ["9 mm", "6 mm"]', "must rise from above 0"),
        ("pressed_share = 1.5", "a share above 0, at most 1"),
        ('name = ""', "non-empty text"),
        ("glue = 1", "glue"),
    ],
)
def test_a_bad_feeder_file_is_refused_by_a_sentence(tmp_path: Path, line: str, sentence: str) -> None:
    lines = {"name": 'name = "mine"', "diameter": 'diameter = ["6 mm", "9 mm"]', "pressed_share": "pressed_share = 0.3"}
    (tmp_path / "mine.toml").write_text("\n".join((lines | {line.partition(" ")[0]: line}).values()))
    with pytest.raises(ConfigError, match=sentence):
        load_feeder(tmp_path / "mine.toml")
