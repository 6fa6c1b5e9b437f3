"""What the judge makes of each turn of stories that were played (thesis 6.6.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.control.painter import as_linear
from pentimento.copainting.evaluation.codraw import Turn
from pentimento.copainting.evaluation.goal_plans import seen
from pentimento.copainting.evaluation.measures import as_tensor, changed_share, surviving_ink
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import clip_score

Picture = NDArray[np.uint8]


def turn_scores(played: Sequence[Sequence[Turn]], judge: Encoder) -> list[dict[str, float | None]]:
    """For each turn, over stories: the judge's score before and after the robot, and what it changed and kept."""
    return [_of_turn([story[number] for story in played], judge) for number in range(len(played[0]))]


def film_strip(story: Sequence[Turn]) -> dict[str, list[Picture]]:
    """A story's pictures in columns: what the person draws, the goal, the plan, what the robot adds."""
    return {
        "person draws": [turn.begun for turn in story],
        "goal": [turn.goal for turn in story],
        "plan": [turn.predicted for turn in story],
        "robot adds": [turn.after for turn in story],
    }


def _of_turn(turns: Sequence[Turn], judge: Encoder) -> dict[str, float | None]:
    side = turns[0].goal.shape[0]
    before, after = (_shrunk([getattr(turn, name) for turn in turns], side) for name in ("begun", "after"))
    goals, prompts = np.stack([turn.goal for turn in turns]), [turn.prompt for turn in turns]
    return {
        "judge_score_no_change": _mean(clip_score(judge, as_tensor(before), prompts)),
        "judge_score": _mean(clip_score(judge, as_tensor(after), prompts)),
        "goal_keeps": _mean(surviving_ink(before, goals)),
        "drawing_keeps": _mean(surviving_ink(before, after)),
        "changed": _mean(changed_share(before, after)),
        "strokes": _mean([turn.strokes[1] for turn in turns]),
    }


def _mean(values: Any) -> float | None:
    """Of the finite ones; None where there is none."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    return float(known.mean()) if len(known) else None


def _shrunk(photos: Sequence[Picture], side: int) -> Picture:
    return np.stack([seen(as_linear(photo), side) for photo in photos])
