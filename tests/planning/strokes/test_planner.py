"""Plans get closer to the target, stay within what tool and canvas allow, and repeat bit by bit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.colour import delta_e_2000, linear_to_srgb, srgb_to_lab
from pentimento.contracts.errors import ImageError
from pentimento.control.safety import envelope_for
from pentimento.planning.adam import half_cosine
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import ExecutionNoise, PlannerConfig
from pentimento.planning.strokes.descent import descend, optimise
from pentimento.planning.strokes.families import round_shares
from pentimento.planning.strokes.palette import cluster_palette
from pentimento.planning.strokes.planner import plan, relocated
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.target import Part, fit_to_canvas, fit_to_ink, load_photograph
from pentimento.robots.tools import load_tool
from tests.planning.strokes.scenes import (
    CONFIG,
    INK,
    PARAMETERS,
    POINTS,
    RATES,
    SIZE_M,
    WHITE,
    brush,
    loss,
    same,
    scene,
    strokes_at,
    unheard,
)


def test_plan_lowers_the_loss() -> None:
    losses: list[float] = []
    strokes, palette = plan(WHITE, scene(), 40, CONFIG, lambda name, value, step: losses.append(value))
    final = loss(strokes, WHITE)
    assert final < 0.3 * losses[0]
    assert len(strokes) == 40
    assert palette.shape[0] <= 3


def test_one_sweep_orders_strokes_from_light_to_dark() -> None:
    strokes, palette = plan(WHITE, scene(), 24, replace(CONFIG, sweeps=1), unheard)
    planned = strokes.planned(scene().tool, POINTS)
    paint = [int(np.abs(palette - stroke.color_srgb).sum(1).argmin()) for stroke in planned]
    assert paint == sorted(paint)
    assert max(np.abs(palette[i] - s.color_srgb).max() for i, s in zip(paint, planned, strict=True)) < 1e-5
    assert (np.diff(srgb_to_lab(palette)[:, 0]) <= 0).all()


def test_planned_strokes_pass_the_safety_envelope() -> None:
    tool = load_tool("round_brush")
    arrays = (
        [[-0.5, 0.3], [0.05, 0.04], [0.2, -0.1]], [0.0, 2.0, -1.0], [9.0, 0.0, 0.03], [-3.0, 1.0, 0.0],
        [[9.0, -9.0, 0.0]] * 3, [[2.0, -1.0, 0.5]] * 3,
    )  # fmt: skip
    wild = Strokes(*(np.array(array, np.float32) for array in arrays))
    wild.keep_within(tool, SIZE_M, 5e-3)
    for stroke in wild.planned(tool, 12):
        envelope_for(tool, SIZE_M).check_path(stroke.path)
        assert stroke.path[:, 1:3].min() >= 5e-3 - 1e-6


def test_optimise_never_raises_the_loss() -> None:
    strokes, _ = plan(WHITE, scene(), 12, CONFIG, unheard)
    before = loss(strokes, WHITE)
    optimise(strokes, WHITE, scene(), CONFIG, iterations=5, free_color=False, rate=80.0, log=unheard)  # too long steps
    after = loss(strokes, WHITE)
    assert after <= before + 1e-9
    kept = strokes.pick(slice(None))
    noisy = replace(CONFIG, execution_noise=ExecutionNoise(0.3, 1e-3))
    optimise(strokes, WHITE, scene(), noisy, iterations=5, free_color=False, rate=80.0, log=unheard)
    assert same(strokes, kept)


def test_execution_noise_makes_plans_robust_to_thin_strokes() -> None:
    """Painted with two thirds of the width, the plan that left room for it is nearer to the target."""
    narrow = replace(PARAMETERS, thickness_at_contact_m=1.4e-3, thickness_per_press=0.7)
    thin = replace(scene(), brush=brush(parameters=narrow))

    def thinly_painted(execution_noise: ExecutionNoise) -> float:
        objective = PrintObjective(scene().target, CONFIG.distances_px)
        config = replace(CONFIG, execution_noise=execution_noise, iterations_free=40)
        plans = [plan(WHITE, scene(), 40, replace(config, seed=s), unheard)[0] for s in range(5)]
        return float(np.mean([objective(render_plan(strokes, WHITE, thin))[0] for strokes in plans]))

    assert thinly_painted(ExecutionNoise(0.15, 0.0)) < thinly_painted(ExecutionNoise(0.0, 0.0))


def test_half_cosine_decreases_between_its_ends() -> None:
    rates = [half_cosine(i, 8, 2.0, 0.5) for i in range(9)]
    assert rates[0] == pytest.approx(2.0)
    assert rates[4] == pytest.approx(1.25)
    assert rates[8] == pytest.approx(0.5)
    assert (np.diff(rates) < 0).all()


def test_round_shares_sum_to_the_count_and_increase() -> None:
    for count, rounds in ((340, 6), (7, 3), (2, 4), (5, 1)):
        shares = round_shares(count, rounds)
        assert sum(shares) == count
        assert len(shares) == rounds
        assert shares[-1] >= shares[0] >= 0


def test_rounds_stop_below_min_gain() -> None:
    """A blank canvas that is already the target asks for no stroke beyond the first round's."""
    blank = replace(scene(), target=WHITE)
    strokes, _ = plan(WHITE, blank, 40, replace(CONFIG, rounds=4, min_gain_per_stroke=1e-6), unheard)
    assert len(strokes) == round_shares(40, 4)[0]
    assert len(plan(WHITE, scene(), 40, replace(CONFIG, rounds=4, min_gain_per_stroke=1e-6), unheard)[0]) == 40


@pytest.mark.parametrize("initialisation", ["random", "error_guided", "saliency"])
def test_each_initialisation_plans_the_requested_strokes(initialisation: str) -> None:
    config = replace(CONFIG, initialisation=initialisation)
    strokes, _ = plan(WHITE, scene(), 12, config, unheard)
    assert len(strokes) == 12
    assert loss(strokes, WHITE) < 0.8 * loss(strokes.pick(slice(0, 0)), WHITE)


def test_guided_planning_beats_the_thesis_planner() -> None:
    """As many strokes and full-resolution iterations; the thesis's strokes start at random and stay what they are."""
    thesis = replace(
        CONFIG, initialisation="random", candidates=1, rounds=1, iterations_per_round=0, relocate_every=0,
        iterations_free=24,
    )  # fmt: skip
    ours = replace(CONFIG, iterations_free=24)

    def ends(config: PlannerConfig) -> float:
        return float(
            np.mean([loss(plan(WHITE, scene(), 30, replace(config, seed=s), unheard)[0], WHITE) for s in range(6)])
        )

    assert ends(ours) < 0.8 * ends(thesis)


def test_plan_is_deterministic() -> None:
    logs: tuple[list[float], list[float]] = ([], [])
    (first, paints), (second, other) = (
        plan(WHITE, scene(), 10, CONFIG, lambda _name, value, _step, log=log: log.append(value)) for log in logs
    )
    assert same(first, second)
    np.testing.assert_array_equal(paints, other)
    assert logs[0] == logs[1] and len(logs[0]) > CONFIG.iterations_palette


def test_plan_keeps_the_markers_colour() -> None:
    strokes, palette = plan(WHITE, scene("marker"), 8, INK, unheard)
    assert np.abs(strokes.color).max() == 0
    np.testing.assert_array_equal(palette, [[0, 0, 0]])


def test_replanning_compensates_displaced_strokes() -> None:
    """Half of the painting came out displaced: the rest, replanned, ends closer to the target than unplanned."""
    strokes, _ = plan(WHITE, scene(), 30, CONFIG, unheard)
    done, left = strokes.pick(slice(0, 15)), strokes.pick(slice(15, None))
    done.middle_m += 0.006
    canvas = render_plan(done, WHITE, scene())

    def error() -> float:
        return loss(left, canvas)

    unplanned = error()
    optimise(left, canvas, scene(), CONFIG, iterations=20, free_color=False, rate=0.1, log=unheard)
    assert error() < unplanned


def test_replanning_relocates_strokes_to_a_gap() -> None:
    """Strokes that lie on one another move to where the photographed canvas is still bare, on top of the others."""
    canvas = scene().target.copy()
    canvas[5:30, 4:12] = 1.0  # a gap at the left
    left = strokes_at(*[(0.09, 0.05)] * 10)
    left.theta_rad[:] = 0
    palette = linear_to_srgb(np.array([[0.6, 0.05, 0.05], [0.05, 0.4, 0.1]]))
    moved = relocated(left, canvas, scene(), replace(CONFIG, relocate_share=0.5), palette_srgb=palette)
    assert len(moved) == 10
    in_gap = moved.middle_m[:, 0] < 0.03
    assert in_gap[-3:].all() and 3 <= in_gap.sum() <= 5
    assert loss(moved, canvas) < 0.9 * loss(left, canvas)
    assert (np.abs(moved.color[in_gap] - (0.05, 0.4, 0.1)).max(1) < 1e-3).all()


def test_cluster_palette_finds_clusters_in_lab() -> None:
    rng = np.random.default_rng(0)
    centres = np.array([[0.9, 0.85, 0.8], [0.5, 0.2, 0.2], [0.1, 0.1, 0.3]])
    colors = np.repeat(centres, 20, axis=0) + rng.normal(0, 0.01, (60, 3))
    palette, paint = cluster_palette(colors, np.ones(60), 3, 0)
    np.testing.assert_array_equal(paint, np.repeat([0, 1, 2], 20))
    assert (delta_e_2000(srgb_to_lab(palette), srgb_to_lab(centres)) < 1.5).all()
    assert len(cluster_palette(np.repeat(centres, 5, axis=0), np.ones(15), 12, 0)[0]) == 3


def test_fit_to_canvas_keeps_proportions_and_orientation() -> None:
    photo = np.zeros((100, 400, 3), np.uint8)
    photo[:50, :, 0] = 255  # red above
    photo[:, 250:, 2] = 255  # blue right of the middle
    fitted = fit_to_canvas(photo, (40, 60))
    assert fitted.shape == (40, 60, 3)
    assert fitted[5, 30, 0] == pytest.approx(1)
    assert fitted[35, 30, 0] == 0
    assert fitted[20, 58, 2] == pytest.approx(1)
    assert fitted[20, 5, 2] == 0


def test_part_of_a_picture_is_that_share_of_its_pixels() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (20, 40, 3)).astype(np.uint8)
    assert (Part(0.0, 0.0, 1.0, 1.0).of(picture) == picture).all()
    assert (Part(0.25, 0.5, 0.75, 0.9).of(picture) == picture[10:18, 10:30]).all()
    assert Part(0.999, 0.0, 1.0, 0.001).of(picture).shape == (1, 1, 3)
    with pytest.raises(ValueError, match="left below right"):
        Part(0.6, 0.0, 0.5, 1.0)


def test_fit_to_ink_maps_tones_from_darkest_to_white() -> None:
    ramp = np.repeat(np.linspace(0, 1, 50)[None, :, None], 3, axis=-1) ** 2 * np.ones((20, 1, 1))
    tones = fit_to_ink(ramp, darkest=0.4)
    assert tones.max() == pytest.approx(1)
    assert tones.min() == pytest.approx(((0.4 + 0.055) / 1.055) ** 2.4)
    assert (np.diff(tones[0, :, 0]) >= 0).all()


def test_fit_to_ink_keeps_a_single_tone() -> None:
    assert fit_to_ink(np.ones((4, 6, 3)), darkest=0.4).min() == pytest.approx(1)
    assert fit_to_ink(np.zeros((4, 6, 3)), darkest=0.4).max() == pytest.approx(((0.4 + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("rounds", 0), ("iterations_free", -1), ("replan_rate", -1.0), ("sweeps", 0), ("path_points", 1),
        ("candidates", 0), ("relocate_every", -1), ("relocate_share", 1.5), ("min_gain_per_stroke", -1.0),
        ("sizes", (0.5, 1.1)),
        ("pixels_per_m", 0.0), ("edge_m", -0.1), ("distances_px", ()), ("distances_px", (4, 0)), ("seed", -1),
    ],
)  # fmt: skip
def test_planner_config_rejects_values_out_of_range(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=rf"^{field} is "):
        replace(CONFIG, **{field: value})
    with pytest.raises(ValueError, match=r"^color is -1; "):
        replace(RATES, color=-1)
    with pytest.raises(ValueError, match=r"^thinning is 1\.0; "):
        ExecutionNoise(1.0, 0.0)


def test_load_photograph_by_name_and_rejects_others(tmp_path: Path) -> None:
    assert load_photograph("chelsea").shape == (300, 451, 3)
    with pytest.raises(ImageError, match=r"no photograph .*astronaut"):
        load_photograph("no_such_cat")
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"not a picture")
    with pytest.raises(ImageError, match=r"broken\.png"):
        load_photograph(str(broken))


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("rounds", [2, 6])
def test_plan_handles_few_strokes(count: int, rounds: int) -> None:
    strokes, palette = plan(WHITE, scene(), count, replace(CONFIG, rounds=rounds), unheard)
    assert len(strokes) == count and len(palette) <= count
    assert loss(strokes, WHITE) < loss(strokes.pick(slice(0, 0)), WHITE)


@pytest.mark.parametrize("name", ["iterations_free", "iterations_palette", "iterations_per_round"])
def test_plan_skips_stages_of_zero_iterations(name: str) -> None:
    strokes, palette = plan(WHITE, scene(), 12, replace(CONFIG, **{name: 0}), unheard)
    assert len(strokes) == 12 and len(palette) <= 3
    assert loss(strokes, WHITE) < 0.8 * loss(strokes.pick(slice(0, 0)), WHITE)


def test_plan_is_independent_of_threads() -> None:
    one, two = (plan(WHITE, replace(scene(), threads=threads), 10, CONFIG, unheard)[0] for threads in (1, 2))
    assert same(one, two)


def test_descend_returns_the_last_iterate() -> None:
    """Unlike ``optimise``, which goes back to the least: not each of these descents ends there."""
    ends_above = []
    for steps in range(3, 13):
        strokes, objective = strokes_at((0.05, 0.04), (0.08, 0.03)), PrintObjective(scene().target, (1, 4))
        task = {"objective": objective, "iterations": steps, "free_color": True, "rate": 80.0}
        values = list(descend(strokes, WHITE, scene(), CONFIG, **task))
        assert len(values) == steps
        ends_above.append(loss(strokes, WHITE) > min(values))
    assert any(ends_above)
