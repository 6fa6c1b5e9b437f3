"""Lines that a person draws on the page, as strokes of the tool."""

import json
from itertools import pairwise

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.control.drawn import drawn_strokes
from pentimento.control.safety import envelope_for
from pentimento.robots.tools import load_tool

SIZE_M = (0.2, 0.1)
PEN, BRUSH = load_tool("marker"), load_tool("round_brush")


def line(*points: tuple[float, float, float], color: object = None) -> str:
    return json.dumps({"points": points, "color": color})


def test_line_runs_where_it_was_drawn_in_the_canvas_frame() -> None:
    (stroke,) = drawn_strokes(line((0.1, 0.2, 0.0), (0.6, 0.2, 1.0)), PEN, SIZE_M)
    path = stroke.path
    assert path[0, 1:3] == pytest.approx([0.02, 0.08]) and path[-1, 1:3] == pytest.approx([0.12, 0.08])
    assert -path[0, 3] == pytest.approx(PEN.press_range_m[0]) and -path[-1, 3] == pytest.approx(PEN.press_range_m[1])
    assert np.diff(path[:, 1]) == pytest.approx(np.diff(path[:, 1]).mean())


@pytest.mark.parametrize("tool", [PEN, BRUSH])
def test_any_line_stays_within_the_tools_envelope(tool) -> None:
    generator = np.random.default_rng(0)
    for count in (1, 2, 40, 400):
        points = generator.uniform(0, 1, (count, 3))
        strokes = drawn_strokes(line(*map(tuple, points.tolist())), tool, SIZE_M)
        for stroke in strokes:
            envelope_for(tool, SIZE_M).check_path(stroke.path)
        ends = [(a.path[-1, 1:3], b.path[0, 1:3]) for a, b in pairwise(strokes)]
        assert all(np.allclose(end, start, atol=2e-4) for end, start in ends)


def test_what_lies_outside_the_sheet_is_not_drawn() -> None:
    out_and_in = line((0.5, 0.5, 0.5), (1.5, 0.5, 0.5), (1.5, 0.2, 0.5), (0.5, 0.2, 0.5))
    there, back = drawn_strokes(out_and_in, PEN, SIZE_M)
    assert there.path[[0, -1], 1] == pytest.approx([0.1, 0.2], abs=3e-4) and np.ptp(there.path[:, 2]) < 1e-9
    assert back.path[[0, -1], 1] == pytest.approx([0.2, 0.1], abs=3e-4) and np.ptp(back.path[:, 2]) < 1e-9
    (through,) = drawn_strokes(line((-1.0, 0.5, 0.5), (2.0, 0.5, 0.5)), PEN, SIZE_M)
    assert through.path[[0, -1], 1] == pytest.approx([0, 0.2], abs=3e-4)
    for outside in (
        line((1.2, 0.5, 0.5)),
        line((-0.1, 0, 0.5), (-0.2, 1, 0.5)),
        line((0.9, -0.3, 0.5), (1.3, 0.1, 0.5)),
    ):
        with pytest.raises(ConfigError, match="outside the sheet"):
            drawn_strokes(outside, PEN, SIZE_M)


def test_any_line_stays_within_the_envelope_also_where_it_leaves_the_sheet() -> None:
    generator = np.random.default_rng(2)
    for _ in range(50):
        points = generator.uniform(-0.5, 1.5, (20, 3))
        for stroke in drawn_strokes(line(*map(tuple, points.tolist())), PEN, SIZE_M):
            envelope_for(PEN, SIZE_M).check_path(stroke.path)


def test_numbers_beyond_any_screen_are_refused() -> None:
    for points in ([(-1e308, 0.5, 0.5), (1e308, 0.5, 0.5)], [(0.5, 0.5, 1e308), (0.6, 0.5, -1e308)]):
        with pytest.raises(ConfigError, match="far outside"):
            drawn_strokes(line(*points), PEN, SIZE_M)


@pytest.mark.parametrize("tool", [PEN, BRUSH])
def test_pixels_of_a_mouse_with_folds_and_loops_are_strokes(tool) -> None:
    """A mouse gives whole pixels: lines that return on themselves, dots of an i, scribbles."""
    generator, side_px, size_m = np.random.default_rng(1), 544, (0.08, 0.08)
    lines = [[(100, 100), (104, 100), (100, 100)], [(100, 100), (110, 100), (100, 100)], [(5, 5), (5, 5)], [(540, 9)]]
    lines += [np.cumsum(generator.integers(-2, 3, (30, 2)), axis=0) + 200 for _ in range(200)]
    lines += [generator.integers(150, 260, (60, 2)) for _ in range(30)]
    for pixels in lines:
        strokes = drawn_strokes(
            line(*((x / side_px, y / side_px, 0.5) for x, y in np.array(pixels).tolist())), tool, size_m
        )
        for stroke in strokes:
            envelope_for(tool, size_m).check_path(stroke.path)


def test_brush_takes_the_persons_colour_and_a_pen_its_own() -> None:
    text = line((0.1, 0.1, 0.5), (0.9, 0.9, 0.5), color=[0.2, 0.4, 1.0])
    brushed = drawn_strokes(text, BRUSH, SIZE_M)
    assert len(brushed) > 1 and all((stroke.color_srgb == [0.2, 0.4, 1.0]).all() for stroke in brushed)
    lengths = [np.linalg.norm(np.diff(stroke.path[:, 1:3], axis=0), axis=1).sum() for stroke in brushed]
    assert max(lengths) <= BRUSH.stroke_length_m[1] * 1.001
    assert (drawn_strokes(text, PEN, SIZE_M)[0].color_srgb == PEN.color_srgb).all()


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "null", "{}", '{"points": []}', '{"points": [[1, 2]]}', '{"points": "x"}', '{"points": 3}',
        '{"points": [[0, NaN, 0]]}', '{"points": [[0, 0, 0]], "color": [2, 0, 0]}',
        '{"points": [[0, 0, 0]], "color": 1}',
        '{"points": [[' + "9" * 400 + ", 0, 0]]}", "[" * 100000,
    ],
)  # fmt: skip
def test_other_texts_are_one_sentence(text: str) -> None:
    with pytest.raises(ConfigError, match="The line that was drawn"):
        drawn_strokes(text, PEN, SIZE_M)
