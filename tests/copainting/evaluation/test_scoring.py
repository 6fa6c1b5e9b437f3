"""The table's numbers where they are known beforehand."""

import numpy as np
import pytest
import torch

from pentimento.copainting.evaluation.answers import Answers
from pentimento.copainting.evaluation.scoring import Judges, comparisons, correlations, found, score, summary
from pentimento.copainting.scenes.collage import HALVES, close_up
from pentimento.semantics.encoder import Encoder, EncoderShape, new_model
from pentimento.semantics.tokenizer import learn_tokenizer

KINDS = ("cup", "sun", "tree")
CAPTIONS = ["a cup", "a tree"]
NOISE = np.random.default_rng(0).integers(0, 256, (2, 16, 16, 3)).astype(np.uint8)


@pytest.fixture(scope="module")
def judges() -> Judges:
    torch.set_num_threads(1)
    tokenizer = learn_tokenizer([*CAPTIONS, "a sun"], 30, 12)
    main, judge = (
        Encoder(new_model(EncoderShape(16, 8, 32, 1, 16, 1, 2, 16), tokenizer, seed), tokenizer) for seed in (0, 1)
    )
    return Judges(main, judge, KINDS)


def table_of(judges: Judges) -> dict[str, dict[str, np.ndarray]]:
    goals = {"base": 255 - NOISE, "fine_tuned": NOISE, "oracle": NOISE, "copy_input": NOISE}
    drawings = dict.fromkeys(("base", "fine_tuned", "oracle", "copy_input", "no_change"), NOISE)
    counts = {name: [3, 5] for name in drawings}
    answers = Answers(NOISE, goals, drawings, counts)
    return score(answers, CAPTIONS, [("cup",), ("tree",)], [HALVES[0][0], None], judges)


def test_gaps_belong_to_methods_with_a_goal_and_scores_to_the_drawing(judges: Judges) -> None:
    rows = summary(table_of(judges), 0)
    assert "delta_pix" not in rows["no_change"] and rows["fine_tuned"]["delta_pix"].value == 0
    difference = np.square((255.0 - 2.0 * NOISE) / 255).mean()
    assert rows["base"]["delta_pix"].value == pytest.approx(difference)
    assert rows["base"]["clip_score"] == rows["oracle"]["clip_score"]  # the drawings are the same
    assert rows["base"]["clip_score"] != rows["base"]["judge_score"]
    assert rows["base"]["strokes"].value == 4


def test_fine_tuning_that_reaches_the_oracle_closes_the_gap(judges: Judges) -> None:
    made = comparisons(table_of(judges), 0)
    assert made["delta_pix_closed"].value == 1 and made["delta_pix_closed"].low == 1
    assert made["judge_score_over_no_change"].value == 0
    assert "delta_pix_ratio" not in made  # over nothing


def test_one_kind_is_the_best_and_all_are_among_as_many(judges: Judges) -> None:
    assert found(judges, NOISE, [KINDS, ()], [None, None])[0] == 1
    assert np.isnan(found(judges, NOISE, [KINDS, ()], [None, None])[1])
    alone = [found(judges, NOISE[:1], [(kind,)], [None])[0] for kind in KINDS]
    assert sorted(alone) == [0, 0, 1]


def test_what_stands_in_the_other_half_changes_nothing(judges: Judges) -> None:
    left = HALVES[0][0]
    crowded = np.random.default_rng(1).integers(0, 256, (8, 16, 16, 3)).astype(np.uint8)
    alone = crowded.copy()
    alone[:, :, 10:] = 255
    asked = [("cup",)] * 8
    assert (found(judges, crowded, asked, [left] * 8) == found(judges, alone, asked, [left] * 8)).all()
    assert (close_up(crowded[0], left) == close_up(alone[0], left)).all()


def test_correlations_are_pearsons(judges: Judges) -> None:
    scores = np.array([1.0, 2.0, 3.0, 4.0])
    made = correlations({"down": -2 * scores, "flat": np.ones(4)}, scores)
    assert set(made) == {"down"} and made["down"]["r"] == pytest.approx(-1) and made["down"]["p"] < 1e-6
    assert correlations({"down": scores[:2]}, scores[:2]) == {}
