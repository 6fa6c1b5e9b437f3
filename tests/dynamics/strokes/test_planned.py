"""A stroke model as the planner asks for it says and differentiates what the simulation does."""

import numpy as np
import pytest
import torch

from pentimento.contracts.covariates import PICKUP_COLUMNS, fresh_memory
from pentimento.dynamics.strokes.extended import StrokeModel, base_model
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.planned import BezierTensors, TorchBrush, planned_marks
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext, View, simulate
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.brush import Span, StrokeTiming
from pentimento.planning.strokes.memory import commanded
from pentimento.planning.strokes.render_plan import render_and_back
from pentimento.planning.strokes.scene import inherit, scene_with
from pentimento.robots.tools import load_tool
from tests.dynamics.strokes.test_correction import some_correction

SIZE_M = (0.12, 0.08)
POINTS = 12
PARAMETERS = Traj2StrokeParameters((1.02, 0.97), (3e-4, -2e-4), 1.0, 2e-3, 0.3, 0.9)
REFERENCE = {
    "column": 0.0, "since": 0.05, "speed_m_s": 0.05, "x_m": 0.06, "y_m": 0.04, "half_m": 0.06, "middle": 0.0,
    "half": 30.0, "spread": 1.0, "usual_age_s": 60.0, "oldest_s": 600.0, "bending_per_m": 50.0, "air": 0.0,
} | {f"share_{k + 1}": 0.1 for k in range(5)}  # fmt: skip
COLUMNS = (
    "since_reload", "ink_since_reload_m", "tool_age_m", "wet_age_s", "t_start_s", "t_after_s", "order", *PICKUP_COLUMNS,
)  # fmt: skip
FITTED = {name: Span(0.0, 1.0, 1e3) for name in (*COLUMNS, "surface_level", "humidity", "humidity_rel")}


def some_strokes(count: int = 5) -> Strokes:
    rng = np.random.default_rng(2)  # none within rounding of where pictures have a kink
    arrays = (
        rng.uniform((0.04, 0.03), (0.08, 0.05), (count, 2)), rng.uniform(-3, 3, count), rng.uniform(0.01, 0.03, count),
        rng.uniform(-3e-3, 3e-3, count), rng.uniform(5e-4, 2e-3, (count, 3)), rng.uniform(0.1, 0.9, (count, 3)),
    )  # fmt: skip
    return Strokes(*(array.astype(np.float32) for array in arrays))


def typical(kind: type[Mechanism]) -> Mechanism:
    return kind(torch.tensor([quantity.typical for quantity in kind.quantities]), REFERENCE)


@pytest.mark.parametrize("tool_name", ["round_brush", "flat_brush"])
@pytest.mark.parametrize("kinds", [(), *((kind,) for kind in VOCABULARY), VOCABULARY], ids=lambda k: "+".join(
    kind.cause for kind in k) if len(k) < 3 else "all")  # fmt: skip
def test_pictures_and_gradients_are_those_of_the_simulation(kinds: tuple[type[Mechanism], ...], tool_name: str) -> None:
    model = StrokeModel(PARAMETERS, tuple(map(typical, kinds)), FITTED if kinds else {}, StrokeTiming(3.0, 5.0))
    compare(model, tool_name)


@pytest.mark.parametrize("kinds", [(), VOCABULARY[:2]], ids=["base", "two causes"])
def test_pictures_and_gradients_of_a_corrected_model_are_those_of_the_simulation(
    kinds: tuple[type[Mechanism], ...],
) -> None:
    correction = some_correction(turned=True).float()
    compare(
        StrokeModel(PARAMETERS, tuple(map(typical, kinds)), FITTED, StrokeTiming(3.0, 5.0), correction), "flat_brush"
    )


def compare(model: StrokeModel, tool_name: str) -> None:
    """The planner's picture and gradients against those of ``simulated``."""
    tool, strokes, rng = load_tool(tool_name), some_strokes(), np.random.default_rng(0)
    canvas, weight = (rng.random((40, 60, 3), np.float32) for _ in range(2))
    scene = scene_with(TorchBrush(model, tool, POINTS), tool, SIZE_M, canvas)
    strokes.inherited = inherit(strokes, scene)
    image, back = render_and_back(strokes, canvas, scene)

    leaves = [torch.tensor(array, requires_grad=True) for array in strokes.arrays()]
    expected = simulated(model, leaves, strokes, tool_name, torch.from_numpy(canvas))
    np.testing.assert_allclose(image, expected.detach().numpy(), atol=2e-4)  # curvature is near rounding
    torch.autograd.backward(expected, torch.from_numpy(weight))
    for found, leaf in zip(back(weight), leaves, strict=True):
        assert leaf.grad is not None
        np.testing.assert_allclose(found, leaf.grad.numpy(), atol=2e-3 * float(leaf.grad.abs().max()))


def simulated(
    model: StrokeModel, leaves: list[torch.Tensor], strokes: Strokes, tool: str, canvas: torch.Tensor
) -> torch.Tensor:
    """By ``simulate``, on paths written out here."""
    middle, theta, length, bend, press, color = leaves
    t = torch.linspace(0, 1, POINTS)
    along, across = length[:, None] * (t - 0.5), bend[:, None] * 3 * t * (1 - t)
    x = middle[:, :1] + theta.cos()[:, None] * along - theta.sin()[:, None] * across
    y = middle[:, 1:] + theta.sin()[:, None] * along + theta.cos()[:, None] * across
    z = -(press @ torch.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2]))
    # Times hang on the drawn length; ``commanded`` says how, and its slope with length is worked out by differences.
    yaw = (theta[:, None] + torch.pi / 2).expand_as(x) if tool == "flat_brush" else torch.zeros_like(x)
    step = torch.stack([x, y], -1).diff(dim=1).norm(dim=-1)
    drawn = torch.cat([torch.zeros_like(step[:, :1]), step.cumsum(1)], 1)
    speed, sharp = load_tool(tool).speed_m_s, 2.0 / 2**0.5
    whole = drawn[:, -1:]
    duration = torch.where(whole > speed**2 / sharp, whole / speed + speed / sharp, 2 * (whole / sharp).sqrt())
    path = torch.stack([duration * drawn / whole, x, y, z, yaw], dim=-1)
    columns = {name: torch.tensor(values)[None] for name, values in (strokes.inherited or {}).items()}
    view = View(torch.tensor([[0.0, SIZE_M[1]]]), torch.tensor([500.0]))
    context = StrokeContext(path[None], columns)
    ground = torch.cat([canvas, torch.zeros(40, 60, 1)], -1)[None] if wets(model) else canvas[None]
    mark, causes, correction = model.mark(), model.mechanisms, model.correction
    return simulate(mark, causes, context, color=color[None], canvas=ground, view=view, correction=correction)[0]


def wets(model: StrokeModel) -> bool:
    return any(mechanism.cause == "wet_mixing" for mechanism in model.mechanisms)


def test_times_and_paths_are_those_that_memory_goes_by() -> None:
    """One geometry in numpy for what is foreseen, one in PyTorch for gradients."""
    from pentimento.dynamics.strokes.planned import _commanded, _geometry

    for name in ("round_brush", "flat_brush"):
        strokes, tool = some_strokes(), load_tool(name)
        strokes.length_m[0] = 4e-4  # too short to reach the tool's speed
        leaves = BezierTensors(*(torch.tensor(array) for array in strokes.arrays()))
        path = _commanded(_geometry(leaves, POINTS), leaves.theta_rad, tool)
        np.testing.assert_allclose(path.numpy(), commanded(strokes, tool, POINTS), atol=2e-6)


def test_the_base_ignores_what_it_was_not_fitted_to() -> None:
    strokes, tool = some_strokes(), load_tool("round_brush")
    leaves = BezierTensors(*(torch.tensor(array) for array in strokes.arrays()))
    fields = planned_marks(base_model(PARAMETERS), tool, leaves, path_points=POINTS, covariates={})
    assert [tuple(field.shape) for field in fields] == [(5, POINTS, 2), *[(5, POINTS)] * 3, (5, 3)]
    assert TorchBrush(base_model(PARAMETERS), tool, POINTS).gain(np.zeros((2, 2), np.float32)) is None


def test_gradients_come_where_they_are_switched_off() -> None:
    brush = TorchBrush(base_model(PARAMETERS), load_tool("round_brush"), POINTS)
    with torch.no_grad():
        marks, pull = brush.marks(some_strokes(), {})
    zeros = [np.zeros_like(array) for array in marks[:-1]]
    zeros[1][:] = 1.0  # wider
    assert (pull(marks._replace(**dict(zip(marks._fields[:-1], zeros, strict=True)))).press_m >= 0).all()


def test_fresh_canvases_hold_no_wet_paint() -> None:
    assert fresh_memory(SIZE_M).ink.max() == 0  # what ``simulated`` takes for granted
