"""Strokes along lines: thinning keeps what is connected, a walk visits each pixel once, strokes cover the lines."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError
from pentimento.planning.strokes.lines import line_strokes, thinned, walks
from pentimento.planning.strokes.scene import Scene, scene_with
from pentimento.robots.tools import load_tool
from tests.planning.strokes.scenes import brush

SIDE = 120


def scene_of(target: NDArray[np.float32], tool: str = "marker") -> Scene:
    """A sheet of 100 mm."""
    return scene_with(brush(tool), load_tool(tool), (0.1, 0.1), target)


def light(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    return np.repeat((image / 255.0).astype(np.float32)[..., None], 3, axis=2)


def drawing(kind: str) -> NDArray[np.uint8]:
    """Black lines of 3 px on white, [SIDE, SIDE]."""
    image = np.full((SIDE, SIDE), 255, np.uint8)
    match kind:
        case "circle":
            cv2.circle(image, (60, 60), 40, 0, 3)
        case "cross":
            cv2.line(image, (20, 20), (100, 100), 0, 3)
            cv2.line(image, (100, 20), (20, 100), 0, 3)
        case "zigzag":
            cv2.polylines(image, [np.array([(15, 90), (40, 30), (65, 90), (90, 30), (105, 90)])], False, 0, 3)
        case "spiral":
            turn = np.linspace(0, 5 * np.pi, 400)
            points = 60 + (3 + 3 * turn)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            cv2.polylines(image, [np.round(points).astype(np.int32)], False, 0, 3)
    return image


MOST = {"circle": 6, "cross": 8, "zigzag": 10, "spiral": 20}
"""Strokes: the straight lines of cross and zigzag are longer than the longest stroke, 50 mm."""
KINDS = tuple(MOST)


@pytest.mark.parametrize("kind", KINDS)
def test_thin_lines_lie_within_the_lines_are_one_pixel_wide_and_stay_connected(kind: str) -> None:
    mask = drawing(kind) < 128
    lines = thinned(mask)
    assert lines.any() and not (lines & ~mask).any()
    blocks = lines[:-1, :-1] & lines[1:, :-1] & lines[:-1, 1:] & lines[1:, 1:]
    assert blocks.sum() <= 2  # where lines cross
    for image in (mask, lines):
        assert cv2.connectedComponents(image.astype(np.uint8), connectivity=8)[0] == 2  # and the paper


@pytest.mark.parametrize("kind", KINDS)
def test_walks_visit_each_pixel_once_in_steps_to_a_neighbour(kind: str) -> None:
    lines = thinned(drawing(kind) < 128)
    found = [walk.astype(int) for walk in walks(lines)]
    places = [tuple(place) for walk in found for place in walk.tolist()]
    assert sorted(places) == sorted(map(tuple, np.argwhere(lines).tolist()))
    assert all(np.abs(np.diff(walk, axis=0)).max(initial=1) == 1 for walk in found)


def test_walk_goes_straight_across_a_crossing() -> None:
    longest = max(walks(thinned(drawing("cross") < 128)), key=len)
    assert np.linalg.norm(longest[-1] - longest[0]) > 100  # one arm of the cross from end to end


@pytest.mark.parametrize("kind", KINDS)
def test_strokes_follow_the_lines_and_leave_none_out(kind: str) -> None:
    image = drawing(kind)
    scene = scene_of(light(image))
    strokes = line_strokes(40, np.ones_like(scene.target), scene)
    points = strokes.paths(60)[..., 1:3].reshape(-1, 2) * scene.pixels_per_m
    rows, columns = SIDE - points[:, 1], points[:, 0]
    from_line = cv2.distanceTransform((image > 127).astype(np.uint8), cv2.DIST_L2, 5)
    assert from_line[rows.astype(int), columns.astype(int)].max() <= 2
    drawn = np.ones_like(image)
    drawn[rows.astype(int), columns.astype(int)] = 0
    from_stroke = cv2.distanceTransform(drawn, cv2.DIST_L2, 5)
    assert (from_stroke[image < 128] <= 4).mean() > 0.98
    assert len(strokes) <= MOST[kind]


def test_what_the_canvas_shows_is_not_drawn_again() -> None:
    target = light(drawing("circle"))
    assert len(line_strokes(40, target, scene_of(target))) == 0


def test_tool_that_takes_paints_is_refused() -> None:
    target = light(drawing("circle"))
    with pytest.raises(ConfigError, match="takes paints"):
        line_strokes(4, np.ones_like(target), scene_of(target, "round_brush"))
