"""What strokes inherit along a plan: as execution records it, by order and dips, and only where a model asks for it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.contracts.covariates import fresh_memory
from pentimento.planning.memory import Extension, beyond_fit, commanded, foreseen, inherited
from pentimento.planning.scene import Mishap, Scene, inherit, render_plan, scene_with
from pentimento.planning.strokes import StrokeTensors, to_planned, with_color
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.runner.act import Session, execute_stroke
from pentimento.stroke_dynamics.extended import Pace, Span, StrokeModel, base_model
from pentimento.stroke_dynamics.mechanisms import VOCABULARY
from pentimento.stroke_dynamics.mechanisms.drying_shift import DryingShift
from pentimento.stroke_dynamics.mechanisms.ink_depletion import InkDepletion
from pentimento.stroke_dynamics.mechanisms.speed_density import SpeedDensity
from pentimento.stroke_dynamics.mechanisms.wet_mixing import WetMixing
from pentimento.stroke_dynamics.simulation import Mechanism
from pentimento.stroke_dynamics.traj2stroke import Traj2StrokeParameters
from pentimento.studio.studio import Studio
from pentimento.studio.world import load_world

SIZE_M = (0.30, 0.20)
POINTS = 16
BRUSH = load_tool("round_brush")
PARAMETERS = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 2e-3, 0.2, 0.9)
WIDE = Span(-1e6, 0.0, 1e6)
ALL = ("since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "wet_age_s", "t_start_s", "order")
RED, BLUE = torch.tensor([0.5, 0.1, 0.1]), torch.tensor([0.1, 0.1, 0.5])


def row_of_strokes(count: int, apart_m: float = 0.02) -> StrokeTensors:
    """Red ones of 40 mm, one above the other."""
    y = 0.02 + apart_m * torch.arange(count)
    strokes = StrokeTensors(
        torch.stack([torch.full((count,), 0.1), y], dim=1),
        torch.zeros(count),
        torch.full((count,), 0.04),
        torch.zeros(count),
        torch.full((count, 3), 1e-3),
        RED.expand(count, 3),
    )
    return with_color(strokes, RED.expand(count, 3))


def extension(*mechanisms: Mechanism, fitted: dict[str, Span] | None = None) -> Extension:
    spans = {name: WIDE for name in ALL} if fitted is None else fitted
    model = StrokeModel(PARAMETERS, mechanisms, spans, Pace(3.0, 5.0))
    return Extension(model, fresh_memory(SIZE_M, BRUSH.nominal_width_m), 0.0, 0)


def scene(*mechanisms: Mechanism, fitted: dict[str, Span] | None = None) -> Scene:
    """White, at 1 pixel a millimetre."""
    extended = extension(*mechanisms, fitted=fitted)
    return Scene(BRUSH, extended.model.mark(), SIZE_M, torch.ones(200, 300, 3), extended)


def effect(kind: type[Mechanism], reference: dict[str, float], **values: float) -> Mechanism:
    """With some of its quantities, by name, and the others at zero."""
    assert set(values) <= {quantity.name for quantity in kind.quantities}
    return kind(torch.tensor([values.get(quantity.name, 0.0) for quantity in kind.quantities]), reference)


def fading() -> Mechanism:
    return effect(InkDepletion, {"column": 0.0, "since": 0.05}, density_loss=0.5)


def darkness(image: torch.Tensor, strokes: StrokeTensors) -> torch.Tensor:
    """In the middle of each stroke."""
    row, column = (200 - strokes.middle_m[:, 1] * 1000).long(), (strokes.middle_m[:, 0] * 1000).long()
    return 1 - image[row, column].mean(-1)


def test_foreseen_is_what_execution_records() -> None:
    rng = np.random.default_rng(2)
    count = 9
    strokes = StrokeTensors(
        torch.tensor(rng.uniform((0.06, 0.06), (0.14, 0.1), (count, 2)), dtype=torch.float32),
        torch.tensor(rng.uniform(-3, 3, count), dtype=torch.float32),
        torch.tensor(rng.uniform(0.01, 0.05, count), dtype=torch.float32),
        torch.tensor(rng.uniform(-0.003, 0.003, count), dtype=torch.float32),
        torch.tensor(rng.uniform(5e-4, 3e-3, (count, 3)), dtype=torch.float32),
        torch.zeros(count, 3),
    )
    strokes = with_color(strokes, torch.stack([RED if i < 6 else BLUE for i in range(count)]))
    robot = VirtualRobot(Studio(load_world("round_brush"), 1))
    robot.change_tool(BRUSH)
    palette = np.stack([RED.numpy(), BLUE.numpy()])
    robot.load_palette(palette)
    session, memory, rows = Session("s", robot.clock_s), fresh_memory(SIZE_M, BRUSH.nominal_width_m), []
    for stroke in to_planned(strokes, BRUSH, POINTS):
        memory, done = execute_stroke(robot, BRUSH, stroke, palette, memory, session)
        rows.append(done.covariates | {"t_start_s": done.event.t_start_s, "order": len(rows)})
    seen = foreseen(strokes, BRUSH, extension(), POINTS, ALL)
    assert [row["since_reload"] for row in rows] == [0, 1, 2, 3, 0, 1, 0, 1, 2]
    for name in ALL:
        recorded = np.array([row[name] for row in rows], dtype=float)
        # The clock is the robot's own: reaching, dipping and wiping take it 3, 5 and 4 s.
        loose = {"wet_age_s": 9.0, "t_start_s": 9.0}.get(name, 0.0)
        np.testing.assert_allclose(seen[name].numpy(), recorded, rtol=1e-4, atol=loose + 1e-6, err_msg=name)


def test_ink_is_used_up_until_the_next_dip() -> None:
    seen = foreseen(row_of_strokes(6), BRUSH, extension(), POINTS, ALL)
    length = 0.04
    torch.testing.assert_close(seen["ink_since_reload_m"], length * torch.tensor([0.0, 1, 2, 3, 0, 1]))
    torch.testing.assert_close(seen["tool_age_m"], length * torch.arange(6.0))
    image = render_plan(row_of_strokes(6), torch.ones(200, 300, 3), scene(fading()), POINTS)
    dark = darkness(image, row_of_strokes(6))
    assert (dark[:4].diff() < -0.02).all()
    torch.testing.assert_close(dark[4:], dark[:2])


def test_order_and_paint_decide_where_dips_fall() -> None:
    """Three red and three blue strokes: sorted they need two dips, alternating six."""
    strokes = row_of_strokes(6)
    colors = torch.stack([RED, RED, RED, BLUE, BLUE, BLUE])
    in_order = with_color(strokes, colors)
    alternating = in_order.pick(torch.tensor([0, 3, 1, 4, 2, 5]))
    dips = [foreseen(plan, BRUSH, extension(), POINTS, ALL)["reload_id"][-1] for plan in (in_order, alternating)]
    assert dips == [2, 6]
    white = torch.ones(200, 300, 3)
    sorted_, mixed = (render_plan(plan, white, scene(fading()), POINTS) for plan in (in_order, alternating))
    assert float((1 - mixed).sum()) > 1.1 * float((1 - sorted_).sum())
    # Without memory, strokes that do not touch give the same picture in any order.
    plain = [render_plan(plan, white, scene(), POINTS) for plan in (in_order, alternating)]
    torch.testing.assert_close(*plain)


def test_a_plan_goes_on_from_what_tool_and_canvas_have_been_through() -> None:
    strokes, whole = row_of_strokes(4), extension()
    robot = VirtualRobot(Studio(load_world("round_brush"), 1))
    robot.load_palette(RED.numpy()[None])
    memory, session = whole.memory, Session("s", robot.clock_s)
    for stroke in to_planned(strokes.pick(slice(0, 2)), BRUSH, POINTS):
        memory, _ = execute_stroke(robot, BRUSH, stroke, RED.numpy()[None], memory, session)
    rest = replace(whole, memory=memory, clock_s=robot.clock_s, made=2)
    at_once = foreseen(strokes, BRUSH, whole, POINTS, ALL)
    then = foreseen(strokes.pick(slice(2, None)), BRUSH, rest, POINTS, ALL)
    for name in ("since_reload", "reload_id", "ink_since_reload_m", "tool_age_m", "order"):
        torch.testing.assert_close(then[name], at_once[name][2:], rtol=1e-4, atol=1e-6)


def test_an_extension_of_no_effect_changes_nothing() -> None:
    strokes = row_of_strokes(6, apart_m=0.004)
    base = scene_with(base_model(PARAMETERS), BRUSH, SIZE_M, torch.ones(200, 300, 3))
    assert base.extension is None
    reference = {
        "column": 0.0, "since": 1.0, "speed_m_s": 0.05, "x_m": 0.1, "y_m": 0.1, "half_m": 0.1, "middle": 0.0,
        "half": 1.0, "spread": 1.0, "usual_age_s": 60.0, "bending_per_m": 50.0,
    } | {f"share_{k + 1}": 0.1 for k in range(5)}  # fmt: skip
    nothing = [kind(torch.zeros(len(kind.quantities)), reference) for kind in VOCABULARY]
    extended = scene(*nothing, fitted={name: WIDE for name in (*ALL, "surface_level")})
    canvas = torch.rand(200, 300, 3, generator=torch.Generator().manual_seed(0))
    mishap = Mishap(torch.full((6, 1), 0.8), torch.full((6, 1, 2), 1e-3))
    for befallen in (None, mishap):
        plain, same = (render_plan(strokes, canvas, task, POINTS, befallen) for task in (base, extended))
        torch.testing.assert_close(same, plain, atol=2e-5, rtol=0)


def test_wet_paint_is_carried_over_and_dry_paint_is_not() -> None:
    strokes = row_of_strokes(2, apart_m=0.0)
    strokes.theta_rad[1] = np.pi / 2
    crossing = with_color(strokes, torch.stack([BLUE, RED]))
    white = torch.ones(200, 300, 3)
    end = (slice(160, 165), slice(98, 103))  # of the vertical stroke, past the horizontal one
    images = {
        usual_s: render_plan(
            crossing, white, scene(effect(WetMixing, {"usual_age_s": usual_s}, pickup_of_fresh=0.5)), POINTS
        )
        for usual_s in (1e-3, 1e3)
    }
    blueness = {usual_s: float((image[end][..., 2] - image[end][..., 0]).mean()) for usual_s, image in images.items()}
    assert blueness[1e3] > blueness[1e-3] + 0.01


def test_gradients_reach_the_strokes_through_what_extends_the_model() -> None:
    strokes = row_of_strokes(5)
    for tensor in strokes.tensors():
        tensor.requires_grad_(True)
    mechanisms = (fading(), effect(SpeedDensity, {"speed_m_s": 0.05}, density_per_log_speed=0.3))
    render_plan(strokes, torch.ones(200, 300, 3), scene(*mechanisms), POINTS).square().mean().backward()
    for name, tensor in zip(("middle", "theta", "length", "bend", "press", "color"), strokes.tensors(), strict=True):
        assert tensor.grad is not None and torch.isfinite(tensor.grad).all(), name
    assert strokes.length_m.grad is not None and (strokes.length_m.grad != 0).all()


def test_what_strokes_carry_is_what_would_be_worked_out() -> None:
    task, white = scene(fading()), torch.ones(200, 300, 3)
    strokes = row_of_strokes(5)
    afresh = render_plan(strokes, white, task, POINTS)
    strokes.inherited = inherit(strokes, task, POINTS)
    assert torch.equal(render_plan(strokes, white, task, POINTS), afresh)
    alone = render_plan(strokes.pick(torch.tensor([3])), white, task, POINTS)  # still the fourth of its load
    assert float(darkness(alone, strokes)[3]) == pytest.approx(float(darkness(afresh, strokes)[3]), abs=1e-6)


def test_beyond_the_fit_values_are_held_and_named() -> None:
    fitted = {"ink_since_reload_m": Span(0.0, 0.03, 0.06), "humidity": Span(0.3, 0.45, 0.6), "order": Span(0, 5, 9)}
    short = extension(fitted=fitted)
    values = inherited(row_of_strokes(5), BRUSH, short, POINTS, fitted)
    torch.testing.assert_close(values["ink_since_reload_m"], torch.tensor([0.0, 0.04, 0.06, 0.06, 0.0]))
    torch.testing.assert_close(values["humidity"], torch.full((5,), 0.45))
    said = beyond_fit(foreseen(row_of_strokes(5), BRUSH, short, POINTS, fitted), short.model)
    assert len(said) == 2
    assert said[0].startswith("ink_since_reload_m runs from 0 to 0.12") and "for 2 of 5 strokes" in said[0]
    assert said[1].startswith("humidity is not known of planned strokes: 0.45 is taken")


def test_all_strokes_are_seen_when_the_last_is_made() -> None:
    names = ("t_start_s", "t_after_s")
    fitted = {"t_start_s": Span(0.0, 6.0, 12.0), "t_after_s": Span(2.0, 8.0, 14.0)}
    strokes, short = row_of_strokes(5), extension(fitted=fitted)
    seen, held = (f(strokes, BRUSH, short, POINTS, names) for f in (foreseen, inherited))
    assert (seen["t_after_s"] == seen["t_after_s"][0]).all() and (seen["t_after_s"] > seen["t_start_s"]).all()
    assert held["t_start_s"].max() == 12.0 < seen["t_start_s"].max()
    ages = [values["t_after_s"] - values["t_start_s"] for values in (seen, held)]
    torch.testing.assert_close(*ages)
    assert [sentence.split()[0] for sentence in beyond_fit(seen, short.model)] == ["t_start_s"]


def test_times_are_those_of_the_executed_path() -> None:
    strokes = row_of_strokes(3)
    strokes.length_m.copy_(torch.tensor([0.008, 0.02, 0.055]))
    paths = commanded(strokes.paths(POINTS), strokes, BRUSH)
    for path, planned in zip(paths, to_planned(strokes, BRUSH, POINTS), strict=True):
        assert float(path[-1, 0]) == pytest.approx(planned.path[-1, 0], rel=0.1)
    flat = commanded(strokes.paths(POINTS), strokes, load_tool("flat_brush"))
    torch.testing.assert_close(flat[..., 4], torch.full((3, POINTS), np.pi / 2))


def test_time_darkens_what_comes_later() -> None:
    drying = effect(DryingShift, {"column": 0.0, "middle": 0.0, "half": 30.0}, density_per_half_session=-0.3)
    strokes = row_of_strokes(6)
    dark = darkness(render_plan(strokes, torch.ones(200, 300, 3), scene(drying), POINTS), strokes)
    assert (dark.diff() < 0).all()
