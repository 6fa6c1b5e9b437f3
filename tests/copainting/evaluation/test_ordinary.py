"""Ordinary edits, completed: what stands beside the completions is right."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pentimento.copainting.evaluation.answers import Asking
from pentimento.copainting.evaluation.ordinary import ordinary_scores
from pentimento.copainting.goal.planner import save_goal_planner
from pentimento.copainting.scenes.edits import Pair
from pentimento.semantics.scores import clip_score
from tests.copainting.goal_planners import small_encoder, small_pairs, small_planner

ASKING = Asking(steps=1, image_guidance=1.0, text_guidance=1.0, seed=0)


def test_inputs_and_targets_get_their_own_scores_and_gains_are_over_the_inputs(tmp_path: Path) -> None:
    torch.set_num_threads(1)
    save_goal_planner(small_planner(), tmp_path / "planner")
    (tmp_path / "judge").mkdir()
    small_encoder().save(tmp_path / "judge")
    edits = small_pairs(3)
    scores = ordinary_scores(tmp_path / "planner", edits, ASKING, tmp_path / "judge", 0)
    for name, pictures in (("copy_input", [e.input for e in edits]), ("target", [e.target for e in edits])):
        shown = torch.from_numpy(np.stack(pictures)).permute(0, 3, 1, 2).float() / 255
        assert scores[name].value == pytest.approx(
            float(clip_score(small_encoder(), shown, [e.caption for e in edits]).mean())
        )
    for name in ("judge_score", "target"):
        gained = scores[name].value - scores["copy_input"].value
        assert scores[f"{name}_over_copy_input"].value == pytest.approx(gained, abs=1e-6)
    assert "goal_keeps" not in scores  # no input has ink


def test_a_planner_that_gives_back_its_input_gains_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pentimento.copainting.evaluation import ordinary

    monkeypatch.setattr(ordinary, "load_goal_planner", lambda folder: None)
    monkeypatch.setattr(ordinary, "ask", lambda planner, inputs, captions, asking: inputs)
    (tmp_path / "judge").mkdir()
    small_encoder().save(tmp_path / "judge")
    edits = [Pair(pair.target, pair.input, pair.caption) for pair in small_pairs(3)]  # inputs with ink
    scores = ordinary_scores(tmp_path, edits, ASKING, tmp_path / "judge", 0)
    gained = scores["judge_score_over_copy_input"]
    assert gained.value == gained.low == gained.high == 0 and scores["goal_keeps"].value == 1
