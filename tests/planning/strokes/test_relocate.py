"""Where strokes start, their contributions, and relocation of useless ones."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.planning.strokes.bezier import Strokes
from pentimento.planning.strokes.config import PlannerConfig
from pentimento.planning.strokes.families import BezierFamily
from pentimento.planning.strokes.initialise import guided_strokes, saliency
from pentimento.planning.strokes.relocate import contributions, relocate, without_useless
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene
from tests.planning.strokes.scenes import (
    CONFIG,
    INK,
    WHITE,
    loss,
    scene,
    strokes_at,
)

SHARP = replace(CONFIG, distances_px=(1,))


def guided(
    count: int, size: float, task: Scene, config: PlannerConfig, paints: np.ndarray | None, seed: int
) -> tuple[Strokes, np.ndarray]:
    return guided_strokes(
        count, size, WHITE, task, config=config, distances_px=config.distances_px, paints=paints,
        rng=np.random.default_rng(seed),
    )  # fmt: skip


def summed_error(strokes: Strokes, task: Scene) -> float:
    """Squared difference of the root of light, over channels' mean and pixels' sum: what ``strokewise`` counts."""
    image = np.maximum(render_plan(strokes, WHITE, task), 0.0)
    return float(np.square(np.sqrt(image) - np.sqrt(task.target)).mean(-1).sum())


def test_contribution_is_the_error_of_leaving_the_stroke_out() -> None:
    strokes = strokes_at((0.03, 0.02), (0.04, 0.025), (0.08, 0.05), (0.09, 0.055), (0.03, 0.06), (0.035, 0.06))
    worth = contributions(strokes, WHITE, scene(), SHARP)
    everyone = summed_error(strokes, scene())
    for s in range(len(strokes)):
        others = strokes.pick(np.array([i for i in range(len(strokes)) if i != s]))
        assert worth[s] == pytest.approx(summed_error(others, scene()) - everyone, rel=1e-3, abs=1e-3)


def test_hidden_stroke_has_no_contribution() -> None:
    twice = strokes_at((0.05, 0.04), (0.05, 0.04), (0.02, 0.02))
    twice.theta_rad[1] = twice.theta_rad[0]
    twice.press_m[0] = 0.3e-3  # thinner than the one over it
    worth = contributions(twice, WHITE, scene(), SHARP)
    assert abs(worth[0]) < 0.1 * worth[2]


def test_without_useless_removes_harmful_strokes() -> None:
    strokes = strokes_at((0.03, 0.02), (0.04, 0.06), (0.08, 0.05), (0.075, 0.025))
    blank = replace(scene(), target=WHITE)  # every stroke on it does harm
    assert len(without_useless(strokes, WHITE, blank, SHARP)) == 0
    corner = replace(scene(), target=scene().target.copy())
    corner.target[:18, :34] = 1.0  # where the second lies, it is to stay white
    kept = without_useless(strokes, WHITE, corner, SHARP)
    np.testing.assert_array_equal(kept.middle_m, strokes.middle_m[[0, 2, 3]])
    assert (contributions(kept, WHITE, corner, SHARP) >= 0).all()
    assert summed_error(kept, corner) < summed_error(strokes, corner)
    assert len(strokes) == 4 and kept.inherited is None


def test_relocate_lowers_the_loss_and_moves_useless_strokes_only() -> None:
    """Of ten strokes at one place, half move, and the loss falls at once."""
    heap = strokes_at(*[(0.03, 0.03)] * 10)
    heap.theta_rad[:] = 0
    config = replace(CONFIG, relocate_share=0.5)
    moved_plan, moved = relocate(
        heap, WHITE, scene(), config=config, family=BezierFamily(config, 10), paints=None, rng=np.random.default_rng(0)
    )
    assert moved == 5
    assert len(moved_plan) == 10
    assert np.array_equal(moved_plan.middle_m[:5], heap.middle_m[:5])
    assert loss(moved_plan, WHITE) < 0.95 * loss(heap, WHITE)


def test_relocate_moves_nothing_at_the_target() -> None:
    strokes = strokes_at((0.03, 0.03), (0.08, 0.05))
    target = render_plan(strokes, WHITE, scene())
    config = replace(CONFIG, relocate_share=1.0)
    same, moved = relocate(
        strokes, WHITE, replace(scene(), target=target), config=config, family=BezierFamily(config, 2), paints=None,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert moved == 0
    assert np.array_equal(same.middle_m, strokes.middle_m)


def test_guided_strokes_start_at_the_error() -> None:
    target = np.ones((40, 60, 3), np.float32)
    target[25:, 45:] = 0.1  # dark at the lower right: large x, small y
    task = replace(scene("marker"), target=target)
    new, gains = guided(20, 0.5, task, INK, None, 0)
    near = (new.middle_m[:, 0] > 0.08) & (new.middle_m[:, 1] < 0.035)
    assert near.mean() > 0.9
    assert gains.sum() > 0


def test_more_candidates_give_better_starts() -> None:
    def start(candidates: int) -> float:
        config = replace(CONFIG, candidates=candidates)
        losses = []
        for seed in range(4):
            new, _ = guided(12, 0.4, scene(), config, None, seed)
            losses.append(loss(new, WHITE))
        return float(np.mean(losses))

    assert start(12) < start(1)


def test_guided_strokes_use_the_given_paints() -> None:
    paints = np.array([[0.6, 0.05, 0.05], [0.05, 0.4, 0.1]])
    new, _ = guided(15, 0.3, scene(), CONFIG, paints, 0)
    distance = np.abs(new.color[:, None] - paints).max(-1)
    assert distance.min(1).max() < 1e-6
    assert set(distance.argmin(1)) == {0, 1}


def test_saliency_is_high_where_colour_differs() -> None:
    picture = scene().target.astype(np.float64)  # a red disc on green
    map_ = saliency(picture)
    assert map_.mean() == pytest.approx(1)
    assert map_[25, 40] > 2 * map_[5, 5]
    np.testing.assert_array_equal(saliency(np.full((8, 9, 3), 0.3)), np.ones((8, 9)))
