"""A drawn brush is one that the pipeline could be given: its files say what was drawn, and nobody trained on it."""

from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest

from pentimento.contracts.errors import PentimentoError
from pentimento.robots.tools import load_tool
from pentimento.studio.strokes.world import load_world
from studies.new_brush import LIKE, NAME, Painted, drawn_brush, line, tool_text, world_text

FOLLOWED = (resources.files("pentimento.robots") / "tools" / f"{LIKE}.toml").read_text()


def test_the_world_file_says_the_world_that_was_drawn(tmp_path: Path) -> None:
    world, _ = drawn_brush(3)
    (tmp_path / "hidden.toml").write_text(world_text(world))
    assert load_world(tmp_path / "hidden.toml") == world


def test_brushes_differ_from_seed_to_seed_and_from_the_one_they_follow() -> None:
    first, second = drawn_brush(1)[0], drawn_brush(2)[0]
    shipped = load_world(LIKE)
    assert drawn_brush(1)[0] == first != second
    for section in ("paper", "camera", "robot", "tool", "paint", "effects"):
        assert getattr(first, section) != getattr(shipped, section)


def test_the_robot_is_told_the_size_and_no_more(tmp_path: Path) -> None:
    (tmp_path / "tool.toml").write_text(tool_text(FOLLOWED, 1.2))
    tool, followed = load_tool(tmp_path / "tool.toml"), load_tool(LIKE)
    assert tool.nominal_width_m == pytest.approx(1.2 * followed.nominal_width_m)
    assert tool.press_range_m == pytest.approx((followed.press_range_m[0], 1.2 * followed.press_range_m[1]))
    same = {"name": LIKE, "nominal_width_m": followed.nominal_width_m, "press_range_m": followed.press_range_m}
    assert tool.name == NAME and replace(tool, **same) == followed


def test_a_tool_file_of_another_shape_is_said() -> None:
    with pytest.raises(PentimentoError, match="no longer says"):
        tool_text(FOLLOWED.replace("7 mm", "8 mm"), 1.2)


def test_bars_are_of_time_and_of_error_and_both_count() -> None:
    within = Painted(1, 1.0, 599.0, ("path_offset",), 0.0119, 0.01, 0.1)
    assert within.met and "+19%" in line(within) and "path_offset" in line(within)
    assert not replace(within, seconds=601.0).met
    assert not replace(within, error=0.0121).met
