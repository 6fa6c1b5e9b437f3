"""Plans of shaped strokes lower the objective, stay near their demonstrations, and are deterministic."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.dynamics.strokes.extended import base_model
from pentimento.handwriting.drawing import TorchPathBrush
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.config import PRINT_ALONE, HandPlanConfig, ShapedPlanConfig, ShapeRates, TextConfig
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.planning.strokes.planner import plan_shapes, plan_strokes
from pentimento.planning.strokes.render_plan import render_and_back, render_plan
from pentimento.planning.strokes.scene import Scene, scene_with
from pentimento.planning.strokes.shapes import BezierShapes, Shapes
from pentimento.robots.tools import load_tool
from tests.planning.strokes.scenes import CONFIG as BEZIER
from tests.planning.strokes.scenes import PARAMETERS, unheard
from tests.planning.strokes.test_shapes import MARKER, hand

POINTS, SIZE_M = 12, (0.12, 0.08)
CONFIG = ShapedPlanConfig(
    candidates=4, rounds=2, iterations_per_round=6, iterations=12, iterations_palette=0, iterations_replan=4,
    replan_rate=0.3, relocate_every=6, relocate_share=0.3, max_latent_distance=1.0,
    palette=PaletteChoice("ink", None, None, None), sweeps=1, path_points=POINTS, pixels_per_m=500.0, edge_m=4e-3,
    distances_px=(1, 4), objectives=PRINT_ALONE, learning_rates=ShapeRates(8e-4, 0.05, 2e-5, 0.05, 0.0), seed=1,
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
    strokes, palette = plan_shapes(
        WHITE, scene(), shapes, 1.0, config=CONFIG, log=lambda *value: heard.append(value[1])
    )
    drawn_m = np.linalg.norm(np.diff(strokes.placed()[0][..., 1:3], axis=1), axis=-1).sum()
    assert drawn_m == pytest.approx(1.0, rel=0.25)
    np.testing.assert_array_equal(palette, [MARKER.color_srgb])
    objective = PrintObjective(scene().target, CONFIG.distances_px)
    blank, after = objective(WHITE)[0], objective(render_plan(strokes, WHITE, scene()))[0]
    assert after < 0.8 * blank
    assert min(heard[-4:]) < heard[0]
    assert len(heard) == 2 * 6 + 12
    if isinstance(shapes, type(hand())):
        assert (np.abs(strokes.parameters - strokes.start) <= shapes.spread * (1 + 1e-6)).all()
        assert (strokes.parameters != strokes.start).any()  # latents take part
    again, _ = plan_shapes(WHITE, scene(), shapes, 1.0, config=CONFIG, log=unheard)
    for one, other in zip(strokes.arrays(), again.arrays(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_plan_shapes_of_zero_length_is_empty() -> None:
    assert len(plan_shapes(WHITE, scene(), hand(), 0.0, config=CONFIG, log=unheard)[0]) == 0


def test_plan_strokes_in_a_hand_draws_as_much_line_as_the_tools_strokes() -> None:
    planner = replace(BEZIER, objectives=PRINT_ALONE, pixels_per_m=500.0)
    config = HandPlanConfig(rounds=3, max_latent_distance=0.5, shape_rate=0.05).of(planner, POINTS)
    assert (config.rounds, config.max_latent_distance, config.path_points) == (3, 0.5, POINTS)
    assert (config.pixels_per_m, config.palette, config.seed) == (planner.pixels_per_m, planner.palette, planner.seed)
    config = replace(config, palette=CONFIG.palette)
    strokes, _ = plan_strokes(WHITE, scene(), 12, config=config, shapes=hand(), log=unheard)
    as_long, _ = plan_shapes(WHITE, scene(), hand(), 12 * np.mean(MARKER.stroke_length_m), config=config, log=unheard)
    assert len(strokes) > 0
    for one, other in zip(strokes.arrays(), as_long.arrays(), strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(ConfigError, match="need a ShapedPlanConfig"):
        plan_strokes(WHITE, scene(), 12, config=config, shapes=None, log=unheard)


def painted() -> Scene:
    """A red and a blue half, for a round brush."""
    tool, target = load_tool("round_brush"), np.ones((40, 60, 3), np.float32)
    target[5:35, 5:30], target[5:35, 30:55] = [0.6, 0.05, 0.05], [0.05, 0.1, 0.5]
    return scene_with(TorchPathBrush(base_model(PARAMETERS), tool, POINTS), tool, SIZE_M, target)


IN_COLOURS = replace(
    CONFIG, palette=PaletteChoice("plan", 2, None, None), sweeps=2, iterations_palette=8,
    learning_rates=ShapeRates(2e-3, 0.1, 8e-4, 0.05, 0.05),
)  # fmt: skip


def test_plan_shapes_paints_with_few_paints_of_the_target() -> None:
    strokes, palette = plan_shapes(WHITE, painted(), hand(), 1.0, config=IN_COLOURS, log=unheard)
    assert len(palette) == 2
    red, blue = sorted(palette.tolist(), key=lambda color: color[2])
    assert red[0] > red[2] + 0.2 and blue[2] > blue[0] + 0.2
    planned = strokes.planned(painted().tool, POINTS)
    assert {tuple(np.round(stroke.color_srgb, 4)) for stroke in planned} <= {tuple(np.round(c, 4)) for c in palette}
    objective = PrintObjective(painted().target, CONFIG.distances_px)
    assert objective(render_plan(strokes, WHITE, painted()))[0] < 0.5 * objective(WHITE)[0]
    assert (np.abs(strokes.parameters - strokes.start) <= hand().spread * (1 + 1e-6)).all()


def test_gradient_of_colours_equals_finite_differences() -> None:
    task = painted()
    strokes, _ = plan_shapes(WHITE, task, hand(), 0.3, config=replace(IN_COLOURS, iterations=0), log=unheard)
    _, back = render_and_back(strokes, WHITE, task)
    of_color = back(np.ones_like(WHITE))[-1]  # of the sum of all light
    stroke = int(np.abs(of_color).sum(1).argmax())
    kept, sums = strokes.color[stroke].copy(), []
    for sign in (1, -1):
        strokes.color[stroke] = kept + np.float32(sign * 0.01)
        sums.append(float(render_plan(strokes, WHITE, task).astype(np.float64).sum()))
    assert float(of_color[stroke].sum()) == pytest.approx((sums[0] - sums[1]) / 0.02, rel=1e-2)


def test_plan_shapes_minimises_any_sum_of_objectives() -> None:
    class Meaning:
        """Words that ask for a black canvas."""

        def text(self, _words: str, _shape: tuple[int, int]) -> PrintObjective:
            return PrintObjective(np.zeros_like(WHITE), (1,))

        def semantic(self, target: np.ndarray) -> PrintObjective:
            raise AssertionError(f"nothing was asked of a target {target.shape}")

    task = replace(painted(), meaning=Meaning())
    light = {}
    for weight in (0.0, 1.0):
        wanted = replace(PRINT_ALONE, text=TextConfig(weight, "night")) if weight else PRINT_ALONE
        strokes, _ = plan_shapes(WHITE, task, hand(), 1.0, config=replace(IN_COLOURS, objectives=wanted), log=unheard)
        light[weight] = float(render_plan(strokes, WHITE, task).mean())
    assert light[1.0] < light[0.0] - 0.02


def test_plan_shapes_rejects_palettes_of_other_tools_and_other_point_counts() -> None:
    brush = load_tool("round_brush")
    with pytest.raises(ConfigError, match=r"palette's source is ink, but the round_brush"):
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
