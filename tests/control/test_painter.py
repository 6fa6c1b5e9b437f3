"""Painting in the studio: batches, looks, and a rest of the plan that makes the best of what is there."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.plan import PlannedStroke
from pentimento.control.guard import GuardedRobot
from pentimento.control.painter import Painting, as_linear, paint, predict, replan_rest
from pentimento.control.safety import envelope_for
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.strokes.brush import LoopTiming, Span
from pentimento.planning.strokes.memory import foreseen
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.scene import Scene, objective_for, scene_with
from pentimento.robots.driver import Robot
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.studio import Studio
from pentimento.studio.world import load_world
from tests.planning.strokes.scenes import CONFIG, unheard

MARKER = load_tool("marker")
SQUARE_M = (0.1, 0.1)
MODEL = StrokeModel(
    Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.1, 1.5e-3, 0.2, 0.95),
    (),
    {"order": Span(0, 9, 99)},
    LoopTiming(3.0, 0.0),
)
INK = replace(CONFIG, palette=replace(CONFIG.palette, source="ink", size=None), pixels_per_m=400.0, edge_m=0.004)


def robot() -> Robot:
    world = load_world("marker")
    hand = VirtualRobot(Studio(replace(world, paper=replace(world.paper, size_m=SQUARE_M)), 0))
    return GuardedRobot(hand, envelope_for(MARKER, SQUARE_M))


def scene() -> Scene:
    """A dark bar across the sheet."""
    target = np.full((40, 40, 3), 0.9, np.float32)
    target[15:26, 5:35] = 0.02
    return scene_with(TorchBrush(MODEL, MARKER, CONFIG.path_points), MARKER, SQUARE_M, target)


@pytest.fixture(scope="module")
def painted() -> tuple[Painting, list[tuple[str, float, int]]]:
    blank = np.full((40, 40, 3), 0.9, np.float32)
    strokes, palette = plan(blank, scene(), 12, INK, unheard)
    logged: list[tuple[str, float, int]] = []
    painting = paint(
        robot(), scene(), strokes, palette_srgb=palette, batch=5, replan=True, config=INK,
        log=lambda *what: logged.append(what),
    )  # fmt: skip
    return painting, logged


def test_every_stroke_is_made_and_every_batch_looked_at(
    painted: tuple[Painting, list[tuple[str, float, int]]],
) -> None:
    painting, logged = painted
    assert len(painting.executed) == 12 and isinstance(painting.executed[0], PlannedStroke)
    assert len(painting.photos) == 1 + 3 == len(painting.deviation)
    assert [(name, made) for name, _, made in logged] == [("deviation", 5), ("deviation", 10), ("deviation", 12)]
    assert painting.deviation[0] == 0 and [value for _, value, _ in logged] == painting.deviation[1:]
    dark = [(photo.mean(-1) < 128).sum() for photo in painting.photos]
    assert dark[0] == 0 and (np.diff(dark) >= 0).all() and dark[-1] > 0


def test_the_painting_is_nearer_to_the_target_than_the_sheet(
    painted: tuple[Painting, list[tuple[str, float, int]]],
) -> None:
    objective = objective_for(scene(), INK)
    before, after = (objective(as_linear(photo))[0] for photo in (painted[0].photos[0], painted[0].photos[-1]))
    assert after < 0.9 * before  # a pen covers only so much in twelve strokes


def test_what_is_left_is_moved_for_the_canvas_as_it_is_and_inherits_anew() -> None:
    """Somebody has painted the left half of the bar: the strokes that were for it find the right."""
    blank = np.full((40, 40, 3), 230, np.uint8)
    half = blank.copy()
    half[15:26, 5:20] = 30
    strokes, _ = plan(as_linear(blank), scene(), 6, INK, unheard)
    objective = objective_for(scene(), INK)

    def ends(left: object) -> float:
        return objective(as_linear(np.rint(255 * np.clip(predict(left, half, scene()), 0, 1)).astype(np.uint8)))[0]

    moved = strokes.pick(slice(None))
    replan_rest(moved, half, scene(), replace(INK, iterations_replan=20, replan_rate=0.5))
    assert ends(moved) < ends(strokes)
    assert moved.inherited is None


def test_the_rest_is_foreseen_from_what_was_made() -> None:
    blank = np.full((40, 40, 3), 0.9, np.float32)
    strokes, _ = plan(blank, scene(), 6, INK, unheard)
    here = scene()
    whole = foreseen(strokes, MARKER, here.brush, here.start, ("order",))
    rest = foreseen(strokes.pick(slice(4, None)), MARKER, here.brush, replace(here.start, made=4), ("order",))
    np.testing.assert_array_equal(rest["order"], whole["order"][4:])
