"""Inherited covariates of a plan: as execution records them, by order and dips, and only where a model needs them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pentimento.contracts.covariates import PICKUP_COLUMNS, fresh_memory
from pentimento.control.execute import Session, execute_stroke
from pentimento.dynamics.strokes.extended import StrokeModel, base_model
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.mechanisms.drying_shift import DryingShift
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.speed_density import SpeedDensity
from pentimento.dynamics.strokes.mechanisms.wet_mixing import WetMixing
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.simulation import Mechanism
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.strokes.bezier import Strokes, with_color
from pentimento.planning.strokes.brush import Span, StrokeTiming
from pentimento.planning.strokes.memory import (
    Start,
    beyond_fit,
    commanded,
    inherited,
    planned_covariates,
)
from pentimento.planning.strokes.render_plan import Fault, render_and_back, render_plan
from pentimento.planning.strokes.scene import Scene, inherit, scene_with
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

Array = NDArray[np.float32]

SIZE_M = (0.30, 0.20)
POINTS = 16
BRUSH = replace(load_tool("round_brush"), max_fade=None)  # dips by count
PARAMETERS = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 2e-3, 0.2, 0.9)
WIDE = Span(-1e6, 0.0, 1e6)
ALL = ("since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "wet_age_s", "t_start_s", "order")
PAINT = (*ALL, *PICKUP_COLUMNS)
RED, BLUE = np.array([0.5, 0.1, 0.1], np.float32), np.array([0.1, 0.1, 0.5], np.float32)
WHITE = np.ones((200, 300, 3), np.float32)
START = Start(fresh_memory(SIZE_M, BRUSH.nominal_width_m), 0.0, 0)


def row_of_strokes(count: int, apart_m: float = 0.02) -> Strokes:
    """Red ones of 40 mm, one above the other."""
    y = 0.02 + apart_m * np.arange(count)
    arrays = (
        np.stack([np.full(count, 0.1), y], axis=1), np.zeros(count), np.full(count, 0.04), np.zeros(count),
        np.full((count, 3), 1e-3), np.zeros((count, 3)),
    )  # fmt: skip
    return with_color(Strokes(*(array.astype(np.float32) for array in arrays)), np.tile(RED, (count, 1)))


def brush(*mechanisms: Mechanism, fitted: dict[str, Span] | None = None) -> TorchBrush:
    spans = {name: WIDE for name in PAINT} if fitted is None else fitted
    return TorchBrush(StrokeModel(PARAMETERS, mechanisms, spans, StrokeTiming(3.0, 5.0)), BRUSH, POINTS)


def scene(*mechanisms: Mechanism, fitted: dict[str, Span] | None = None) -> Scene:
    """White, at 1 pixel a millimetre."""
    return scene_with(brush(*mechanisms, fitted=fitted), BRUSH, SIZE_M, WHITE)


def effect(kind: type[Mechanism], reference: dict[str, float], **values: float) -> Mechanism:
    """With some of its quantities, by name, and the others at zero."""
    assert set(values) <= {quantity.name for quantity in kind.quantities}
    return kind(torch.tensor([values.get(quantity.name, 0.0) for quantity in kind.quantities]), reference)


def fading() -> Mechanism:
    return effect(InkDepletion, {"column": 0.0, "since": 0.05}, density_loss=0.5)


def darkness(image: Array, strokes: Strokes) -> Array:
    """In the middle of each stroke."""
    row, column = (200 - strokes.middle_m[:, 1] * 1000).astype(int), (strokes.middle_m[:, 0] * 1000).astype(int)
    return 1 - image[row, column].mean(-1)


def test_planned_covariates_equal_those_recorded_in_execution() -> None:
    rng = np.random.default_rng(2)
    count = 9
    arrays = (
        rng.uniform((0.06, 0.06), (0.14, 0.1), (count, 2)), rng.uniform(-3, 3, count), rng.uniform(0.01, 0.05, count),
        rng.uniform(-0.003, 0.003, count), rng.uniform(5e-4, 3e-3, (count, 3)), np.zeros((count, 3)),
    )  # fmt: skip
    strokes = Strokes(*(array.astype(np.float32) for array in arrays))
    strokes = with_color(strokes, np.stack([RED if i < 6 else BLUE for i in range(count)]))
    robot = VirtualRobot(Studio(load_world("round_brush"), 1))
    robot.change_tool(BRUSH)
    palette = np.stack([RED, BLUE]).astype(np.float64)
    robot.load_palette(palette)
    session, memory, rows = Session("s", robot.clock_s), fresh_memory(SIZE_M, BRUSH.nominal_width_m), []
    for stroke in strokes.planned(BRUSH, POINTS):
        memory, done = execute_stroke(robot, BRUSH, stroke, palette_srgb=palette, memory=memory, session=session)
        rows.append(done.covariates | {"t_start_s": done.event.t_start_s, "order": len(rows)})
    seen = planned_covariates(strokes, BRUSH, brush(), START, names=ALL)
    assert [row["since_reload"] for row in rows] == [0, 1, 2, 3, 0, 1, 0, 1, 2]
    for name in ALL:
        recorded = np.array([row[name] for row in rows], dtype=float)
        # The clock is the robot's own: reaching, dipping and wiping take it 3, 5 and 4 s.
        loose = {"wet_age_s": 9.0, "t_start_s": 9.0}.get(name, 0.0)
        np.testing.assert_allclose(seen[name], recorded, rtol=1e-4, atol=loose + 1e-6, err_msg=name)


def test_ink_depletes_until_the_next_dip() -> None:
    seen = planned_covariates(row_of_strokes(6), BRUSH, brush(), START, names=ALL)
    length = 0.04
    np.testing.assert_allclose(seen["ink_since_reload_m"], length * np.array([0.0, 1, 2, 3, 0, 1]), rtol=1e-5)
    np.testing.assert_allclose(seen["tool_age_m"], length * np.arange(6.0), rtol=1e-5)
    image = render_plan(row_of_strokes(6), WHITE, scene(fading()))
    dark = darkness(image, row_of_strokes(6))
    assert (np.diff(dark[:4]) < -0.02).all()
    np.testing.assert_allclose(dark[4:], dark[:2], rtol=1e-5)


def test_dips_depend_on_order_and_paint() -> None:
    """Three red and three blue strokes: sorted they need two dips, alternating six."""
    strokes = row_of_strokes(6)
    colors = np.stack([RED, RED, RED, BLUE, BLUE, BLUE])
    in_order = with_color(strokes, colors)
    alternating = in_order.pick(np.array([0, 3, 1, 4, 2, 5]))
    dips = [
        planned_covariates(plan, BRUSH, brush(), START, names=ALL)["reload_id"][-1] for plan in (in_order, alternating)
    ]
    assert dips == [2, 6]
    sorted_, mixed = (render_plan(plan, WHITE, scene(fading())) for plan in (in_order, alternating))
    assert float((1 - mixed).sum()) > 1.1 * float((1 - sorted_).sum())
    # Without memory, strokes that do not touch give the same picture in any order.
    plain = [render_plan(plan, WHITE, scene()) for plan in (in_order, alternating)]
    np.testing.assert_allclose(*plain, atol=1e-6)


def test_covariates_continue_from_the_start_state() -> None:
    strokes = row_of_strokes(4)
    robot = VirtualRobot(Studio(load_world("round_brush"), 1))
    robot.load_palette(RED[None].astype(np.float64))
    memory, session = START.memory, Session("s", robot.clock_s)
    for stroke in strokes.pick(slice(0, 2)).planned(BRUSH, POINTS):
        memory, _ = execute_stroke(
            robot, BRUSH, stroke, palette_srgb=RED[None].astype(np.float64), memory=memory, session=session
        )
    rest = Start(memory, robot.clock_s, made=2)
    at_once = planned_covariates(strokes, BRUSH, brush(), START, names=ALL)
    then = planned_covariates(strokes.pick(slice(2, None)), BRUSH, brush(), rest, names=ALL)
    for name in ("since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "order"):
        np.testing.assert_allclose(then[name], at_once[name][2:], rtol=1e-4, atol=1e-6)


def test_mechanisms_of_zero_strength_change_nothing() -> None:
    strokes = row_of_strokes(6, apart_m=0.004)
    base = scene_with(TorchBrush(base_model(PARAMETERS), BRUSH, POINTS), BRUSH, SIZE_M, WHITE)
    assert inherit(strokes, base) == {} and base.gain is None
    reference = {
        "column": 0.0, "since": 1.0, "speed_m_s": 0.05, "x_m": 0.1, "y_m": 0.1, "half_m": 0.1, "middle": 0.0,
        "half": 1.0, "spread": 1.0, "usual_age_s": 60.0, "oldest_s": 600.0, "bending_per_m": 50.0,
    } | {f"share_{k + 1}": 0.1 for k in range(5)}  # fmt: skip
    nothing = [kind(torch.zeros(len(kind.quantities)), reference) for kind in VOCABULARY]
    extended = scene(*nothing, fitted={name: WIDE for name in (*PAINT, "surface_level")})
    canvas = np.random.default_rng(0).random((200, 300, 3), np.float32)
    fault = Fault(np.full((6, 1), 0.8, np.float32), np.full((6, 1, 2), 1e-3, np.float32))
    for befallen in (None, fault):
        plain, same = (render_plan(strokes, canvas, task, befallen) for task in (base, extended))
        np.testing.assert_allclose(same, plain, atol=2e-5, rtol=0)


def test_wet_paint_is_picked_up_and_dry_paint_is_not() -> None:
    strokes = row_of_strokes(2, apart_m=0.0)
    strokes.theta_rad[1] = np.pi / 2
    crossing = with_color(strokes, np.stack([BLUE, RED]))
    end = (slice(160, 165), slice(98, 103))  # of the vertical stroke, past the horizontal one
    images = {
        usual_s: render_plan(crossing, WHITE, scene(effect(WetMixing, {"usual_age_s": usual_s}, pickup_of_fresh=0.5)))
        for usual_s in (1e-3, 1e3)
    }
    blueness = {usual_s: float((image[end][..., 2] - image[end][..., 0]).mean()) for usual_s, image in images.items()}
    assert blueness[1e3] > blueness[1e-3] + 0.01


def test_picked_up_paint_is_carried_until_the_next_dip() -> None:
    """One red stroke; blue ones: across it, beside it, and beside it after a dip (the tool's fourth of a load)."""
    strokes = row_of_strokes(7)
    strokes.middle_m[1] = strokes.middle_m[0]
    strokes = with_color(strokes, np.stack([RED] + 6 * [BLUE]))
    seen = planned_covariates(strokes, BRUSH, brush(), START, names=PAINT)
    np.testing.assert_array_equal(seen["since_reload"], [0, 0, 1, 2, 3, 0, 1])
    share = seen["carried_share"]
    assert share[0] == 0 and share[1] > 0.2  # of itself, in its middle: half
    np.testing.assert_allclose(share[2:5], 2 * share[1], rtol=1e-5)
    np.testing.assert_array_equal(share[5:], 0)
    mixed = np.stack([seen[name] for name in PICKUP_COLUMNS[1:]], axis=1)
    np.testing.assert_allclose(mixed[1:5], strokes.color[[0] * 4], rtol=1e-4)
    np.testing.assert_allclose(mixed[[0, 5, 6]], strokes.color[[0, 5, 6]], rtol=1e-4)
    dirty, clean = (
        render_plan(strokes.pick([2]), WHITE, scene(effect(WetMixing, {"usual_age_s": 60.0}, carried=amount)))
        for amount in (1.0, 0.0)
    )
    np.testing.assert_array_equal(dirty, clean)  # alone in a plan nothing was crossed
    dirty, clean = (
        render_plan(strokes, WHITE, scene(effect(WetMixing, {"usual_age_s": 60.0}, carried=amount)))
        for amount in (1.0, 0.0)
    )
    change = np.abs(dirty - clean).max(axis=(1, 2))  # [rows], row 0 at the top: the strokes lie one above the other
    rows = np.rint((SIZE_M[1] - strokes.middle_m[:, 1]) * 1000 - 0.5).astype(int)
    assert (change[rows[1:5]] > 0.05).all() and (change[rows[5:]] < 1e-6).all()


def test_gradients_flow_through_mechanisms() -> None:
    strokes = row_of_strokes(5)
    mechanisms = (fading(), effect(SpeedDensity, {"speed_m_s": 0.05}, density_per_log_speed=0.3))
    image, back = render_and_back(strokes, WHITE, scene(*mechanisms))
    gradients = back(2 * image / image.size)
    for name, array in zip(("middle", "theta", "length", "bend", "press", "color"), gradients, strict=True):
        assert np.isfinite(array).all(), name
    assert (gradients[2] != 0).all() and (gradients[-1] != 0).any()


def test_stored_covariates_equal_computed_ones() -> None:
    task = scene(fading())
    strokes = row_of_strokes(5)
    afresh = render_plan(strokes, WHITE, task)
    strokes.inherited = inherit(strokes, task)
    assert np.array_equal(render_plan(strokes, WHITE, task), afresh)
    alone = render_plan(strokes.pick(np.array([3])), WHITE, task)  # still the fourth of its load
    assert float(darkness(alone, strokes)[3]) == pytest.approx(float(darkness(afresh, strokes)[3]), abs=1e-6)


def test_covariates_beyond_the_fit_are_clipped_and_reported() -> None:
    fitted = {"ink_since_reload_m": Span(0.0, 0.03, 0.06), "humidity": Span(0.3, 0.45, 0.6), "order": Span(0, 5, 9)}
    short = brush(fitted=fitted)
    values = inherited(row_of_strokes(5), BRUSH, short, START)
    np.testing.assert_allclose(values["ink_since_reload_m"], [0.0, 0.04, 0.06, 0.06, 0.0], rtol=1e-5)
    np.testing.assert_allclose(values["humidity"], np.full(5, 0.45), rtol=1e-6)
    warnings = beyond_fit(planned_covariates(row_of_strokes(5), BRUSH, short, START, names=fitted), fitted)
    assert len(warnings) == 2
    assert (
        warnings[0].startswith("ink_since_reload_m runs from 0 to 0.12") and "2 of 5 strokes are clipped" in warnings[0]
    )
    assert warnings[1].startswith("A plan does not determine humidity; its mean over the fitted strokes, 0.45")


def test_t_after_is_the_end_of_the_last_stroke() -> None:
    names = ("t_start_s", "t_after_s")
    fitted = {"t_start_s": Span(0.0, 6.0, 12.0), "t_after_s": Span(2.0, 8.0, 14.0)}
    strokes, short = row_of_strokes(5), brush(fitted=fitted)
    seen, held = planned_covariates(strokes, BRUSH, short, START, names=names), inherited(strokes, BRUSH, short, START)
    assert (seen["t_after_s"] == seen["t_after_s"][0]).all() and (seen["t_after_s"] > seen["t_start_s"]).all()
    assert held["t_start_s"].max() == 12.0 < seen["t_start_s"].max()
    ages = [values["t_after_s"] - values["t_start_s"] for values in (seen, held)]
    np.testing.assert_allclose(*ages, rtol=1e-5)
    assert [sentence.split()[0] for sentence in beyond_fit(seen, fitted)] == ["t_start_s"]


def test_commanded_times_agree_with_the_executed_path() -> None:
    strokes = row_of_strokes(3)
    strokes.length_m[:] = [0.008, 0.02, 0.055]
    paths = commanded(strokes, BRUSH, POINTS)
    for path, planned in zip(paths, strokes.planned(BRUSH, POINTS), strict=True):
        assert float(path[-1, 0]) == pytest.approx(planned.path[-1, 0], rel=0.1)
    flat = commanded(strokes, load_tool("flat_brush"), POINTS)
    np.testing.assert_allclose(flat[..., 4], np.full((3, POINTS), np.pi / 2), rtol=1e-6)


def test_drying_shift_depends_on_time() -> None:
    drying = effect(DryingShift, {"column": 0.0, "middle": 0.0, "half": 30.0}, density_per_half_session=-0.3)
    strokes = row_of_strokes(6)
    dark = darkness(render_plan(strokes, WHITE, scene(drying)), strokes)
    assert (np.diff(dark) < 0).all()
