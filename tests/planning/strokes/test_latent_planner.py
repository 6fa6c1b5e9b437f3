"""Plans of shaped strokes lower the objective, stay near their demonstrations, and are deterministic."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.dynamics.strokes.extended import base_model
from pentimento.handwriting.drawing import TorchPathBrush
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.config import ShapedPlanConfig, ShapeRates
from pentimento.planning.strokes.planner import plan_shapes
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, scene_with
from pentimento.planning.strokes.shapes import BezierShapes, Shapes
from pentimento.robots.tools import load_tool
from tests.planning.strokes.scenes import PARAMETERS, unheard
from tests.planning.strokes.test_shapes import MARKER, hand

POINTS, SIZE_M = 12, (0.12, 0.08)
CONFIG = ShapedPlanConfig(
    candidates=4, rounds=2, iterations_per_round=6, iterations=12, relocate_every=6, relocate_share=0.3,
    max_latent_distance=1.0,
    path_points=POINTS, pixels_per_m=500.0, edge_m=4e-3, distances_px=(1, 4),
    learning_rates=ShapeRates(8e-4, 0.05, 2e-5, 0.05), seed=1,
)  # fmt: skip
WHITE = np.ones((40, 60, 3), np.float32)
BRUSH = TorchPathBrush(base_model(replace(PARAMETERS, thickness_at_contact_m=1e-3)), MARKER, POINTS)


def scene() -> Scene:
    """A dark disc on white."""
    rows, columns = np.meshgrid(np.arange(40), np.arange(60), indexing="ij")
    dark = ((rows - 20) ** 2 + (columns - 35) ** 2 < 150)[..., None]
    return scene_with(BRUSH, MARKER, SIZE_M, np.where(dark, 0.1, np.ones(3)).astype(np.float32))


@pytest.mark.parametrize("shapes", [hand(), BezierShapes(MARKER, POINTS)], ids=["hand", "bezier"])
def test_plan_shapes_lowers_the_objective_deterministically(shapes: Shapes) -> None:
    heard: list[float] = []
    strokes = plan_shapes(WHITE, scene(), shapes, 0.35, config=CONFIG, log=lambda *value: heard.append(value[1]))
    drawn_m = np.linalg.norm(np.diff(strokes.placed()[0][..., 1:3], axis=1), axis=-1).sum()
    assert drawn_m == pytest.approx(0.35, rel=0.25)
    objective = PrintObjective(scene().target, CONFIG.distances_px)
    blank, after = objective(WHITE)[0], objective(render_plan(strokes, WHITE, scene()))[0]
    assert after < 0.8 * blank
    assert min(heard[-4:]) < heard[0]
    assert len(heard) == 2 * 6 + 12
    if isinstance(shapes, type(hand())):
        assert (np.abs(strokes.parameters - strokes.start) <= shapes.spread * (1 + 1e-6)).all()
        assert (strokes.parameters != strokes.start).any()  # latents take part
    again = plan_shapes(WHITE, scene(), shapes, 0.35, config=CONFIG, log=unheard)
    for one, other in zip(strokes.arrays(), again.arrays(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_plan_shapes_of_zero_length_is_empty() -> None:
    assert len(plan_shapes(WHITE, scene(), hand(), 0.0, config=CONFIG, log=unheard)) == 0


def test_plan_shapes_rejects_paints_and_other_point_counts() -> None:
    brush = load_tool("round_brush")
    with pytest.raises(ConfigError, match="takes paints"):
        plan_shapes(WHITE, replace(scene(), tool=brush), hand(), 0.1, config=CONFIG, log=unheard)
    with pytest.raises(ConfigError, match="do not fit"):
        plan_shapes(WHITE, scene(), hand(points=9), 0.1, config=CONFIG, log=unheard)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"candidates": 0}, "candidates is 0"),
        ({"relocate_share": 1.5}, "at most 1"),
        ({"distances_px": ()}, "at least one"),
    ],
)
def test_shaped_plan_config_rejects_values_out_of_range(change: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        replace(CONFIG, **change)
