from dataclasses import replace

from pentimento.dynamics.strokes.evaluation import constant_width
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.report.parameters import parameter_table, polyline_sentence

MODEL = Traj2StrokeParameters((0.98, 1.02), (0.0003, -0.0002), 0.6, 0.0008, 1.0, 0.9)


def test_each_parameter_is_said_with_its_unit_and_meaning() -> None:
    html = parameter_table(MODEL, "round brush").replace("&nbsp;", " ").replace("\N{NO-BREAK SPACE}", " ")
    for text in (
        "50 mm across the canvas (x) comes out 49.0 mm long",
        "50 mm up the canvas (y) comes out 51.0 mm long",
        "+0.30 mm", "0.30 mm to the right of where", "0.20 mm below where",
        "0.600 mm/mm", "widens the mark by 1.20 mm",
        "0.80 mm", "draws a line 1.60 mm wide",
        "covers 50 % of what it covers on the path",
        "covers 90 % of what lies below",
    ):  # fmt: skip
        assert text in html


def test_a_tool_that_marks_only_when_pressed_is_described_so() -> None:
    html = parameter_table(replace(MODEL, thickness_at_contact_m=-0.0003), "brush")
    assert "starts to widen only when the tool is pressed deeper than 0.50" in html


def test_no_shift_is_said_plainly() -> None:
    assert "lies where it was commanded" in parameter_table(replace(MODEL, offset_m=(0.0, 0.0)), "brush")


def test_the_polyline_is_said_by_its_full_width() -> None:
    text = polyline_sentence(constant_width(0.0015, 0.9), constant_width(0.002, 0.99))
    assert "3.00 mm wide" in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "would be 4.00 mm" in text
