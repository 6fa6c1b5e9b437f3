"""Push models on the canvas, in files, and as the planner uses them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ConfigError
from pentimento.dynamics.pushes.evaluation import predict
from pentimento.dynamics.pushes.push_model import planned_clay, planned_members, read_push_model, write_push_model
from pentimento.planning.pushes.rollout import PushModel
from tests.dynamics.pushes.conftest import Trained

WINDOW = np.array([0.0, 0.0, 0.12, 0.12])
ACTION = np.array([0.05, 0.055, 0.4, 0.02, 0.006])


def test_push_model_round_trips(trained: Trained, tmp_path: Path) -> None:
    write_push_model(trained.model, tmp_path)
    again = read_push_model(tmp_path)
    assert again.facts == trained.model.facts
    assert torch.equal(predict(again, trained.held_out), predict(trained.model, trained.held_out))


def test_push_model_files_are_reproducible(trained: Trained, tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        write_push_model(trained.model, tmp_path / name)
    for file in ("config.json", "weights.safetensors"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes()


def test_rejects_folder_without_push_model(trained: Trained, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no push model"):
        read_push_model(tmp_path)
    write_push_model(trained.model, tmp_path)
    weights = tmp_path / "weights.safetensors"
    whole = weights.read_bytes()
    for broken in (whole[: len(whole) // 2], b"version https://git-lfs.github.com/spec/v1\n"):
        weights.write_bytes(broken)
        with pytest.raises(ConfigError, match="holds no push model"):
            read_push_model(tmp_path)
    weights.write_bytes(whole)
    config = tmp_path / "config.json"
    config.write_text(config.read_text().replace('"members": 2', '"members": 3'))
    with pytest.raises(ConfigError, match="holds no push model"):
        read_push_model(tmp_path)


def test_predicts_no_change_outside_crop(trained: Trained) -> None:
    before = torch.full((1, 60, 60), 0.04)
    action = torch.tensor([[0.03, 0.03, 0.0, 0.02, 0.006]])
    change = trained.model.after(before, torch.tensor([[0.0, 0.0, 0.12, 0.12]]), action)[0] - before[0]
    assert (change[:25, 45:] == 0).all()  # the upper right corner is beyond the crop
    assert change.min() < -1e-3


def height() -> np.ndarray:
    rng = np.random.default_rng(0)
    return (0.04 + 2e-4 * rng.standard_normal((60, 60))).astype(np.float32)


def test_after_matches_step_for_each_action(trained: Trained) -> None:
    clay: PushModel = planned_clay(trained.model, WINDOW)
    actions = np.stack([ACTION, ACTION + np.array([0.01, 0.0, 1.0, 0.0, -0.002])])
    both = clay.after(height(), actions)
    assert both.shape == (2, 60, 60)
    assert both.dtype == np.float32
    for number in range(2):
        np.testing.assert_allclose(both[number], clay.step(height(), actions[number])[0], atol=1e-7)
    assert clay.after(height(), np.empty((0, 5))).shape == (0, 60, 60)
    assert clay.end_effector == "ball"


def test_step_gradients_match_finite_differences(trained: Trained) -> None:
    clay = planned_clay(trained.model, WINDOW)
    # On noise, the median at the start moves differently from the mean that gives its gradient.
    row, column = np.mgrid[:60, :60]
    smooth = (0.04 + 1e-3 * np.sin(row / 12 + column / 17)).astype(np.float32)
    weights = (np.sin(np.arange(60) / 9)[:, None] * np.cos(np.arange(60) / 7)).astype(np.float32)

    def objective(height_m: np.ndarray, action: np.ndarray) -> float:
        return float((clay.step(height_m, action)[0].astype(np.float64) * weights).sum())

    to_height, to_action = clay.step(smooth, ACTION)[1](weights)
    for index, small in enumerate([5e-5, 5e-5, 1e-3, 2e-5, 2e-5]):
        moved = small * np.eye(5)[index]
        slope = (objective(smooth, ACTION + moved) - objective(smooth, ACTION - moved)) / (2 * small)
        # Bilinear sampling has kinks at pixel borders.
        assert to_action[index] == pytest.approx(slope, rel=0.02, abs=0.05 if index < 2 else 1e-3)
    # At the end of the travel, because a bump near the start would move the median.
    down, across = (np.arange(60) - 27)[:, None], np.arange(60) - 35
    bump = 1e-4 * np.exp(-(down**2 + across**2) / 12).astype(np.float32)
    slope = objective(smooth + bump, ACTION) - objective(smooth - bump, ACTION)
    assert 2 * float((to_height * bump).sum()) == pytest.approx(slope, rel=0.05, abs=2e-6)


def test_planned_clay_is_mean_of_members(trained: Trained) -> None:
    whole = planned_clay(trained.model, WINDOW).after(height(), ACTION[None])
    members = [clay.after(height(), ACTION[None]) for clay in planned_members(trained.model, WINDOW)]
    assert len(members) == 2
    np.testing.assert_allclose(np.mean(members, axis=0), whole, atol=1e-7)
    assert np.abs(members[0] - members[1]).max() > 1e-6
