"""The particle model moves, turns and rises with the slab; the page says who is better and whether times are equal."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from studies.sculpting.particles import RADIUS_M, ParticleClay, ParticleNetwork, moved, particles_around
from studies.sculpting.planners import ERRORS, OURS, PLANNERS
from studies.sculpting.planners_page import section

PIXEL_M = 0.2 / 64
WINDOW_M = torch.tensor([[0.0, 0.0, 0.2, 0.2]])
PUSH = torch.tensor([[0.093, 0.101, 0.4, 0.03, 0.006]])


def network() -> ParticleNetwork:
    """A network that moves the clay, untrained."""
    torch.manual_seed(0)
    made = ParticleNetwork().requires_grad_(False)
    made.out.weight.normal_()
    return made


def slab() -> Tensor:
    """[1, 64, 64]: rough in the middle, level towards the edge."""
    height = torch.full((1, 64, 64), 0.03)
    height[:, 12:52, 12:52] += 0.001 * torch.randn(1, 40, 40, generator=torch.Generator().manual_seed(1))
    return height


def change(made: ParticleNetwork, height: Tensor, push: Tensor) -> Tensor:
    return moved(made, height, WINDOW_M, push) - height


def test_the_prediction_moves_with_slab_and_push_by_whole_pixels() -> None:
    made, height = network(), slab()
    there = PUSH + PIXEL_M * torch.tensor([[3.0, 2.0, 0.0, 0.0, 0.0]])
    before, after = change(made, height, PUSH), change(made, height.roll((-2, 3), (1, 2)), there)
    assert before.abs().max() > 1e-4
    torch.testing.assert_close(after, before.roll((-2, 3), (1, 2)), atol=1e-6, rtol=0)


def test_the_prediction_turns_with_slab_and_push_by_a_quarter() -> None:
    made, height = network(), slab()
    x, y, theta, *rest = PUSH[0].tolist()
    turned = torch.tensor([[0.2 - y, x, theta + np.pi / 2, *rest]])
    after = change(made, height.rot90(1, (1, 2)), turned)
    torch.testing.assert_close(after, change(made, height, PUSH).rot90(1, (1, 2)), atol=1e-6, rtol=0)


def test_the_prediction_rises_with_the_slab() -> None:
    made, height = network(), slab()
    torch.testing.assert_close(change(made, height + 0.01, PUSH), change(made, height, PUSH), atol=1e-6, rtol=0)


def test_a_mirrored_push_is_a_push_into_a_mirrored_slab() -> None:
    made, height = network(), slab()
    x, y, theta, *rest = PUSH[0].tolist()
    seen, *_ = particles_around(height, WINDOW_M, PUSH)
    mirrored, *_ = particles_around(height.flip(1), WINDOW_M, torch.tensor([[x, 0.2 - y, -theta, *rest]]))
    torch.testing.assert_close(made(mirrored, -torch.ones(1)), made(seen, torch.ones(1)).flip(1), atol=1e-6, rtol=0)


def test_particles_far_from_the_path_stay_and_an_untrained_network_moves_none() -> None:
    height = slab()
    column, row = np.meshgrid(np.arange(64) + 0.5, np.arange(64) + 0.5)
    x, y, theta, length, _ = PUSH[0].tolist()
    right, up = PIXEL_M * column - x, 0.2 - PIXEL_M * row - y
    along = np.clip(np.cos(theta) * right + np.sin(theta) * up, 0, length)
    apart = np.hypot(right - along * np.cos(theta), up - along * np.sin(theta))
    assert not change(network(), height, PUSH)[0].numpy()[apart > RADIUS_M].any()
    assert not change(ParticleNetwork().requires_grad_(False), height, PUSH).any()


def test_the_gradient_is_that_of_finite_differences() -> None:
    made, height, push = network().double(), slab().double(), PUSH.double().requires_grad_(True)
    weight = torch.randn(1, 64, 64, generator=torch.Generator().manual_seed(2), dtype=torch.float64)

    def total(action: Tensor) -> Tensor:
        return (weight * moved(made, height, WINDOW_M.double(), action)).sum()

    (gradient,) = torch.autograd.grad(total(push), push)
    steps = 1e-7 * torch.eye(5, dtype=torch.float64)[:, None]
    numeric = torch.stack([(total(push + step) - total(push - step)) / 2e-7 for step in steps])
    torch.testing.assert_close(gradient[0], numeric.detach(), rtol=1e-4, atol=1e-6)


def test_a_step_is_one_of_the_alternatives() -> None:
    clay, height, push = (
        ParticleClay(network(), window_m=WINDOW_M[0].numpy(), tool="ball"),
        slab()[0].numpy(),
        PUSH.double().numpy(),
    )
    np.testing.assert_allclose(clay.step(height, push[0])[0], clay.after(height, push)[0], atol=1e-7)


def said(better: float, slower: float) -> dict[str, Any]:
    """Results where the project's planner leaves 0.3 of each error of three goals, and each other one 0.3 + better."""
    runs = [
        {
            "planner": name, "goal": goal, "seed": 1, "actions": 24, "plans": 6,
            "cpu_s": 2.0 * (1 if name == OURS else slower),
            **{key: [2.0, 2.0 * (0.3 + spread + (0 if name == OURS else better))] for key in ERRORS},
        }
        for goal, spread in (("letter:A", 0.0), ("face", 0.1), ("knot", 0.2)) for name in PLANNERS
    ]  # fmt: skip
    scores = {name: {"l_3d_mm2": 0.03, "l_viz": 0.002} for name in ("network", "particles", "no change")}
    return {
        "material": "foam", "actions": 24, "pixels": 64, "runs": runs, "predictions": scores, "fit_seed": 99,
        "candidates": dict.fromkeys(PLANNERS, 16), "test": {"seed": 31, "pushes": 40},
        "epochs": {"network": 40, "particles": 60}, "screened": 12,
    }  # fmt: skip


def test_the_page_says_that_ours_is_better_and_times_are_equal() -> None:
    text = " ".join(section(said(0.05, 1.04)).replace("\u00a0", " ").split())
    assert (
        "lower objective than the rivals and than doing nothing on 3 of 3 goals (100 %): the bar of 80 % is met."
        in text
    )
    assert "| greedy, more candidates | 5.0 % ± 0.0 % | 3 of 3 | 5.0 % ± 0.0 % | 3 of 3 |" in text
    assert "The times differ by at most 4.0 %." in text and "is better than the project's planner" not in text


def test_the_page_says_that_ours_is_worse_and_times_are_not_equal() -> None:
    text = " ".join(section(said(-0.05, 1.3)).replace("\u00a0", " ").split())
    assert "on 0 of 3 goals (0.0 %): the bar of 80 % is missed." in text
    assert "*greedy, more candidates* is better than the project's planner" in text
    assert (
        "The time of screened and greedy and gradient and cross-entropy and particles (height) and particles is off"
        in text
    )


def test_a_part_of_our_planner_is_no_rival() -> None:
    results = said(0.05, 1.0)
    for run in results["runs"]:
        if run["planner"] == "screened":
            run |= {key: [2.0, 0.2] for key in ERRORS}
    text = " ".join(section(results).replace("\u00a0", " ").split())
    assert "on 3 of 3 goals (100 %): the bar of 80 % is met." in text
    assert "*all places screened, more candidates* is better than the project's planner" in text
