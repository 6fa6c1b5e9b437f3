import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.strokes.evaluation import constant_width
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.report.html import Album
from pentimento.report.tools import StrokePictures, ToolInputs, parameter_rows, read_tool, tool_section
from tests.report.conftest import HELD_OUT, PICTURES

MODEL = Traj2StrokeParameters((0.98, 1.02), (0.0003, -0.0002), 0.6, 0.0008, 1.0, 0.9)


@pytest.fixture
def weights_copy(tool_folders: tuple[Path, Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(tool_folders[1], tmp_path / "weights"))


def test_only_held_out_strokes_are_read(tool: ToolInputs) -> None:
    assert set(tool.held_out.action.tolist()) == set(HELD_OUT)


def test_model_of_other_strokes_is_refused(tool_folders: tuple[Path, Path], weights_copy: Path) -> None:
    (weights_copy / "held_out_actions.json").write_text("[999]")
    with pytest.raises(ContractError, match="train the model on these strokes again"):
        read_tool("round_brush", tool_folders[0], weights_copy, PICTURES)


def test_missing_scores_are_named(tool_folders: tuple[Path, Path], weights_copy: Path) -> None:
    (weights_copy / "metrics.json").write_text("{}")
    with pytest.raises(ContractError, match=r"'held_out'.*train_stroke_dynamics"):
        read_tool("round_brush", tool_folders[0], weights_copy, PICTURES)


def test_pictures_need_one_stroke_and_two_path_points() -> None:
    with pytest.raises(ValueError, match="at least one"):
        StrokePictures(shown=0, path_points=16, pixels_per_m=1000.0, margin_m=0.01)
    with pytest.raises(ValueError, match=r"path_points is 1; it must be 2 or more"):
        StrokePictures(shown=3, path_points=1, pixels_per_m=1000.0, margin_m=0.01)


def parameters(model: Traj2StrokeParameters) -> str:
    return " | ".join(cell for row in parameter_rows(model) for cell in row).replace("\N{NO-BREAK SPACE}", " ")


def test_parameters_have_units_and_meanings() -> None:
    text = parameters(MODEL)
    for part in (
        "50 mm across the canvas (x) is 49.0 mm long",
        "50 mm up the canvas (y) is 51.0 mm long",
        "+0.30 mm", "0.30 mm to the right of the commanded", "0.20 mm below the commanded",
        "0.600 mm/mm", "widens the mark by 1.20 mm",
        "0.80 mm", "draws a line 1.60 mm wide",
        "coverage is 50 % of that on the path",
        "covers 90 % of what lies below",
    ):  # fmt: skip
        assert part in text


def test_negative_thickness_at_contact_is_a_min_press() -> None:
    assert "widens only beyond a press of 0.50" in parameters(replace(MODEL, thickness_at_contact_m=-0.0003))


def test_zero_offset_is_the_commanded_position() -> None:
    assert "has the commanded position" in parameters(replace(MODEL, offset_m=(0.0, 0.0)))


def section(tool: ToolInputs) -> str:
    return tool_section(tool, 1, Album()).replace("\N{NO-BREAK SPACE}", " ")


def test_section_compares_the_model_with_the_polyline(tool: ToolInputs) -> None:
    pens = replace(tool, polyline=constant_width(0.0015, 0.9), crisp=constant_width(0.002, 0.99))
    text = section(replace(pens, counts=tool.counts | {"quarantined": 1}))
    assert "trained on 3 strokes and tested on 3 others (1 row of the table violated the contract" in text
    assert "0.200 higher than the polyline’s" in text and "2.50 times smaller than the polyline’s" in text
    assert "3.00 mm wide" in text and "A second fit, 4.00 mm wide" in text


def test_section_states_where_the_model_is_worse_than_the_polyline(tool: ToolInputs) -> None:
    held_out = tool.scores["held_out"]
    swapped = held_out | {"model": held_out["polyline"], "polyline": held_out["model"]}
    text = section(replace(tool, scores=tool.scores | {"held_out": swapped}))
    assert "0.200 lower than the polyline’s" in text and "2.50 times larger than the polyline’s" in text
    assert "violated" not in text


def test_parameters_of_strokes_in_their_own_frames_speak_of_the_stroke() -> None:
    text = " ".join(cell for row in parameter_rows(MODEL, own_frame=True) for cell in row)
    assert "along its direction (x) is 49.0 mm long" in text and "0.30 mm ahead of the commanded" in text
    assert "sideways (y)" in text and "0.20 mm to the right of the commanded" in text and "canvas (x)" not in text
