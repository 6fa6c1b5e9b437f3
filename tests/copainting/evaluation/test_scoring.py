"""Gaps, shares of ink, the scores of methods, and their correlations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import torch

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.schema import arrow_schema
from pentimento.control.layout import Window
from pentimento.copainting.evaluation import scoring
from pentimento.copainting.evaluation.cases import Case
from pentimento.copainting.evaluation.methods import Outcomes
from pentimento.copainting.evaluation.scoring import (
    Judges,
    added,
    changed_share,
    comparisons,
    correlations,
    delta_pix,
    delta_sem,
    edit_scores,
    objects_found,
    painted_gap,
    score,
    summary,
    surviving_ink,
)
from pentimento.copainting.goal.planner import SeededSampling, save_goal_planner
from pentimento.copainting.scenes.edits import Pair
from pentimento.semantics.encoder import Encoder, EncoderShape, as_images, new_model
from pentimento.semantics.scores import clip_score
from pentimento.semantics.tokenizer import learn_tokenizer
from tests.copainting.goal_planners import small_encoder, small_pairs, small_planner

WHITE = np.full((2, 16, 16, 3), 255, np.uint8)


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    tokenizer = learn_tokenizer(["a red disc", "a blue square"], 20, 12)
    return Encoder(new_model(EncoderShape(16, 8, 32, 2, 16, 1, 2, 16), tokenizer, 0), tokenizer)


def test_delta_pix_is_the_mean_squared_difference_at_any_size() -> None:
    grey = np.full_like(WHITE, 204)  # 255 - 51 = a fifth
    assert delta_pix(WHITE, grey) == pytest.approx([0.04, 0.04])
    large = np.full((1, 64, 64, 3), 255, np.uint8)
    assert delta_pix(large, large - 51) == pytest.approx([0.04])
    assert (delta_pix(grey, grey) == 0).all()


def test_delta_sem_is_one_minus_the_cosine_of_embeddings(encoder: Encoder) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (2, 16, 16, 3)).astype(np.uint8)
    assert delta_sem(encoder, noise, noise) == pytest.approx([0, 0], abs=1e-6)
    apart = delta_sem(encoder, WHITE, noise)
    assert ((apart > 0) & (apart <= 2)).all()
    assert apart == pytest.approx(delta_sem(encoder, noise, WHITE), abs=1e-6)
    one, other = (encoder.embed_images(as_images(p)).detach().numpy() for p in (WHITE, noise))
    assert apart == pytest.approx(1 - (one * other).sum(-1), abs=1e-5)


def test_surviving_ink_tolerates_a_shift_of_one_pixel() -> None:
    drawn = WHITE.copy()
    drawn[0, :, 8] = 0
    shifts = [surviving_ink(drawn, np.roll(drawn, by, axis=2))[0] for by in (0, 1, 2)]
    assert shifts == [1, 1, 0]
    assert np.isnan(surviving_ink(drawn, drawn)[1])  # no ink that could survive


def test_changed_share_counts_pixels_from_the_threshold_on() -> None:
    other = WHITE.copy()
    other[0, :4, :, 1] -= 64
    other[1, :4, :, 1] -= 63
    assert changed_share(WHITE, other) == pytest.approx([0.25, 0])


KINDS = ("cup", "sun", "tree")
CAPTIONS = ["a cup", "a tree"]
NOISE = np.random.default_rng(0).integers(0, 256, (2, 16, 16, 3)).astype(np.uint8)
PAPER = np.full_like(NOISE, 255)


@pytest.fixture(scope="module")
def judges() -> Judges:
    tokenizer = learn_tokenizer([*CAPTIONS, "a sun"], 30, 12)
    main, judge = (
        Encoder(new_model(EncoderShape(16, 8, 32, 1, 16, 1, 2, 16), tokenizer, seed), tokenizer) for seed in (0, 1)
    )
    return Judges(main, judge, KINDS)


def table_of(judges: Judges) -> dict[str, dict[str, np.ndarray]]:
    goals = {"base": 255 - NOISE, "fine_tuned": NOISE, "oracle": NOISE, "copy_input": NOISE}
    drawings = dict.fromkeys(("base", "fine_tuned", "oracle", "copy_input", "no_change"), NOISE)
    counts = {name: [3, 5] for name in drawings}
    cases = [case("a cup", ("cup",)), case("a tree", ("tree",))]
    return score(Outcomes(NOISE, goals, drawings, counts), cases, judges)


def case(caption: str, objects: tuple[str, ...]) -> Case:
    return Case("scene", caption, objects, NOISE[0], NOISE[0], ())


def test_gaps_belong_to_methods_with_a_goal_and_scores_to_the_drawing(judges: Judges) -> None:
    rows = summary(table_of(judges), 0)
    assert "delta_pix" not in rows["no_change"] and rows["fine_tuned"]["delta_pix"].value == 0
    difference = np.square((255.0 - 2.0 * NOISE) / 255).mean()
    assert rows["base"]["delta_pix"].value == pytest.approx(difference)
    assert rows["base"]["clip_score"] == rows["oracle"]["clip_score"]  # the drawings are the same
    assert rows["base"]["clip_score"] != rows["base"]["judge_score"]
    assert rows["base"]["strokes"].value == 4


def test_fine_tuning_that_reaches_the_oracle_closes_the_gap(judges: Judges) -> None:
    result = comparisons(table_of(judges), 0)
    assert result["delta_pix_closed"].value == 1 and result["delta_pix_closed"].low == 1
    assert result["judge_score_over_no_change"].value == 0
    assert "delta_pix_ratio" not in result  # over nothing


def test_objects_found_among_as_many_best_kinds_as_asked_for(judges: Judges) -> None:
    both = objects_found(judges, PAPER, NOISE, [case("all", KINDS), case("none", ())])
    assert both[0] == 1 and np.isnan(both[1])
    alone = [objects_found(judges, PAPER[:1], NOISE[:1], [case(kind, (kind,))])[0] for kind in KINDS]
    assert sorted(alone) == [0, 0, 1]


def test_things_in_windows_are_looked_at_one_by_one(judges: Judges) -> None:
    """Two drawings in two windows score the mean of each drawing alone."""
    left, right = Window(0.25, 0.25, 0.5), Window(0.75, 0.75, 0.5)
    generator = np.random.default_rng(2)
    sheet = np.full((1, 32, 32, 3), 255, np.uint8)
    one, other = sheet.copy(), sheet.copy()
    one[0, 4:12, 4:12] = generator.integers(0, 100, (8, 8, 3))
    other[0, 20:28, 20:28] = generator.integers(0, 100, (8, 8, 3))
    both = np.minimum(one, other)
    for first in KINDS:
        for second in KINDS:
            asked = replace(case("", (first, second)), windows=(left, right))
            alone = [
                objects_found(judges, sheet, drawing, [case("", (kind,))])[0]
                for drawing, kind in ((one, first), (other, second))
            ]
            assert objects_found(judges, sheet, both, [asked])[0] == np.mean(alone)


def test_judge_sees_what_was_added_wherever_it_is_and_nothing_else() -> None:
    thing = np.random.default_rng(1).integers(0, 100, (10, 10, 3)).astype(np.uint8)
    views = []
    for top, left, begun in ((0, 0, False), (30, 4, False), (14, 54, True)):
        canvas = np.full((64, 64, 3), 255, np.uint8)
        if begun:
            canvas[40:60, 5:25] = 30
        drawing = canvas.copy()
        drawing[top : top + 10, left : left + 10] = thing
        views.append(added(canvas, drawing))
    assert views[0].shape == (64, 64, 3)
    assert all((view == views[0]).all() for view in views)
    assert 0.5 < (views[0] < 200).all(-1).mean() < 0.9  # the thing fills the view but for a margin
    assert (added(canvas, canvas) == 255).all()


def test_correlations_are_pearsons(judges: Judges) -> None:
    scores = np.array([1.0, 2.0, 3.0, 4.0])
    result = correlations({"down": -2 * scores, "flat": np.ones(4)}, scores)
    assert set(result) == {"down"} and result["down"]["r"] == pytest.approx(-1) and result["down"]["p"] < 1e-6
    assert correlations({"down": scores[:2]}, scores[:2]) == {}


def tables() -> tuple[pa.Table, pa.Table]:
    """Scenes, and co-paintings whose full paintings are other scenes: gaps differ."""
    known = scenes.example_table(8)
    rows = copaintings.example_table(8, seed=1).to_pylist()
    result = [
        row | {"scene_id": name, "region": None} for row, name in zip(rows, known["scene_id"].to_pylist(), strict=True)
    ]
    return known, pa.Table.from_pylist(result, schema=arrow_schema(copaintings.CONTRACT))


def test_painted_gap_counts_each_full_painting_once() -> None:
    known, pairs = tables()
    found = painted_gap(pairs, known, small_encoder())
    assert {name: row["paintings"] for name, row in found.items()} == {"delta_pix": 8, "delta_sem": 8}
    assert all(-1 <= row["r"] <= 1 for row in found.values())
    parts = pa.Table.from_pylist(
        [row | {"region": 1, "caption": "something else"} for row in pairs.to_pylist()], schema=pairs.schema
    )
    assert painted_gap(pa.concat_tables([pairs, pairs, parts]), known, small_encoder()) == found


def test_painted_gap_is_empty_without_matching_scenes() -> None:
    known, pairs = tables()
    assert painted_gap(pairs, known.slice(0, 0), small_encoder()) == {}


SAMPLING = SeededSampling(steps=1, image_guidance=1.0, text_guidance=1.0, seed=0)


def test_edit_scores_compare_completions_with_inputs_and_targets(tmp_path: Path) -> None:
    save_goal_planner(small_planner(), tmp_path / "planner")
    (tmp_path / "judge").mkdir()
    small_encoder().save(tmp_path / "judge")
    edits = small_pairs(3)
    scores = edit_scores(tmp_path / "planner", edits, SAMPLING, judge=tmp_path / "judge", seed=0)
    for name, pictures in (("copy_input", [e.input for e in edits]), ("target", [e.target for e in edits])):
        shown = torch.from_numpy(np.stack(pictures)).permute(0, 3, 1, 2).float() / 255
        assert scores[name].value == pytest.approx(
            float(clip_score(small_encoder(), shown, [e.caption for e in edits]).mean())
        )
    for name in ("judge_score", "target"):
        gained = scores[name].value - scores["copy_input"].value
        assert scores[f"{name}_over_copy_input"].value == pytest.approx(gained, abs=1e-6)
    assert "goal_keeps" not in scores  # no input has ink


def test_planner_that_returns_its_input_gains_zero(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "load_goal_planner", lambda folder: None)
    monkeypatch.setattr(scoring, "complete_canvases", lambda planner, inputs, captions, sampling: inputs)
    (tmp_path / "judge").mkdir()
    small_encoder().save(tmp_path / "judge")
    edits = [Pair(pair.target, pair.input, pair.caption) for pair in small_pairs(3)]  # inputs with ink
    scores = edit_scores(tmp_path, edits, SAMPLING, judge=tmp_path / "judge", seed=0)
    gained = scores["judge_score_over_copy_input"]
    assert gained.value == gained.low == gained.high == 0 and scores["goal_keeps"].value == 1
