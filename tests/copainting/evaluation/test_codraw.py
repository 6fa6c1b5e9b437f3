"""Turns of a person and a robot on one sheet in the studio, and their scores."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from pentimento.contracts import scenes
from pentimento.contracts.errors import ContractError
from pentimento.contracts.scenes import phrase
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.copainting.evaluation.codraw import (
    Codrawing,
    Story,
    Turn,
    codraw,
    film_strip,
    stories,
    turn_scores,
    wishes,
)
from pentimento.copainting.evaluation.goal_plans import as_sheet, plan_text
from pentimento.copainting.evaluation.scoring import seen_there
from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes
from pentimento.robots.driver import Robot
from pentimento.robots.virtual import VirtualRobot
from pentimento.semantics.encoder import Encoder, EncoderShape, as_images, new_model
from pentimento.semantics.objective import TextObjective
from pentimento.semantics.scores import object_scores
from pentimento.semantics.tokenizer import learn_tokenizer
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from tests.copainting.goal_planners import small_encoder
from tests.copainting.media import MEDIUM, cross, marker_paint_context, paper

CONFIG = Codrawing(stories=1, person_strokes=4, robot_strokes=6, tremor_m=0.0005, replan_every=4, wishes=2, largest=0.5)


def robot() -> Robot:
    world = load_world("marker")
    square = replace(world, paper=replace(world.paper, size_m=(MEDIUM.side_m, MEDIUM.side_m)))
    hand = VirtualRobot(Studio(square, 0))
    return GuardedRobot(hand, envelope_for(marker_paint_context().tool, hand.canvas_size_m))


def test_each_prompt_of_a_story_names_one_more_thing() -> None:
    table = build_scenes(ScenesConfig(60, 32, 0.0, 0.5, 4, 0), lambda *_: None)
    story = stories(table, 1, 3)[0]
    row = next(r for r in table.to_pylist() if r["scene_id"] == story.scene_id)
    first, second, _ = row["objects"]
    assert first in story.prompts[0] and second not in story.prompts[0]
    assert first in story.prompts[1] and second in story.prompts[1]
    assert all(kind in story.prompts[2] for kind in row["objects"])
    assert len({image.tobytes() for image in story.images}) == 3
    with pytest.raises(ContractError, match="draw more scenes"):
        stories(scenes.example_table(5), 1, 3)  # one thing each


def test_each_turn_starts_from_the_last_photograph() -> None:
    table = build_scenes(ScenesConfig(60, 32, 0.0, 0.5, 4, 0), lambda *_: None)
    asked: list[str] = []

    def goal_for(photo: np.ndarray, prompt: str) -> np.ndarray:
        asked.append(prompt)
        assert photo.shape == (32, 32, 3) and photo.dtype == np.uint8
        return np.minimum(photo, cross())

    story = stories(table, 1, 3)[0]
    turns = codraw(robot(), marker_paint_context(), story, goal_for, config=CONFIG, seed=0)
    assert tuple(asked) == story.prompts == tuple(turn.prompt for turn in turns)
    for turn, following in pairwise(turns):
        assert np.array_equal(following.before, turn.after)
    dark = [int((photo.mean(-1) < 128).sum()) for turn in turns for photo in (turn.before, turn.started, turn.after)]
    assert dark[0] == 0 and dark[1] > 0 and dark[2] > dark[1]  # ink is there after the person, and more after the robot
    assert turns[0].strokes[0] <= CONFIG.person_strokes and 1 <= turns[0].strokes[1] <= CONFIG.robot_strokes


def test_plan_by_text_lowers_the_text_objective() -> None:
    tokenizer = learn_tokenizer(["a cup", "a tree"], 30, 12)
    encoder = Encoder(new_model(EncoderShape(16, 8, 32, 1, 16, 1, 2, 16), tokenizer, 0), tokenizer)
    sheet = as_sheet(paper(), MEDIUM.side_px)
    objective = TextObjective(encoder, "a cup", 0, 0)
    none, some = (
        float(
            objective(
                torch.tensor(
                    plan_text(
                        marker_paint_context(),
                        sheet,
                        "a cup",
                        encoder=encoder,
                        strokes=6,
                        iterations=n,
                        views=0,
                        seed=3,
                    ).sheet
                )
            )
        )
        for n in (0, 25)
    )
    assert some < none
    result = plan_text(
        marker_paint_context(), sheet, "a cup", encoder=encoder, strokes=6, iterations=3, views=1, seed=3
    )
    assert len(result.strokes) == 6 and result.palette_srgb.shape == (1, 3)


TOLD = [Story("by_hand", ("a red disc",), (None,), 32, None)]


def turn(before: np.ndarray, after: np.ndarray, strokes: int) -> Turn:
    return Turn("a red disc", paper(), before, before, after, after, (1, strokes))


def test_turn_scores_measure_kept_and_changed_ink() -> None:
    kept, lost = turn(cross(), cross(), 0), turn(cross(), paper(), 4)
    scores = turn_scores([[kept, kept], [kept, lost]], TOLD, small_encoder(), ())
    assert scores[0]["drawing_keeps"] == 1 and scores[0]["changed"] == 0 and scores[0]["strokes"] == 0
    assert scores[0]["judge_score"] == pytest.approx(scores[0]["judge_score_no_change"])
    assert scores[1]["drawing_keeps"] == 0.5 and scores[1]["strokes"] == 2
    share = (cross() != paper()).any(-1).mean() / 2
    assert scores[1]["changed"] == pytest.approx(share)


def test_turn_scores_without_ink_are_none() -> None:
    assert turn_scores([[turn(paper(), cross(), 3)]], TOLD, small_encoder(), ())[0]["drawing_keeps"] is None


def test_turn_scores_look_for_the_first_thing_where_it_was_drawn() -> None:
    encoder, kinds = small_encoder(), ("cat", "disc")
    shown = seen_there(paper(), cross(), cross())
    best = kinds[int(object_scores(encoder, as_images([shown]), kinds).argmax())]
    played = [[turn(paper(), cross(), 3), turn(cross(), cross(), 0)]]
    for first in kinds:
        told = [Story("by_hand", ("a disc", "a cat"), (None, None), 32, first)]
        scores = turn_scores(played, told, encoder, kinds)
        assert [each["first_found"] for each in scores] == [float(first == best)] * 2
        share = (cross() != paper()).any(-1).mean()
        assert [each["covered"] for each in scores] == pytest.approx([share] * 2)


def test_wishes_ask_for_another_thing_in_each_turn_and_the_person_draws_nothing() -> None:
    story = wishes(2, turns=3, side_px=32, seed=0)[1]
    assert len(set(story.prompts)) == 3 and story.images == (None,) * 3
    assert story.first is not None and story.prompts[0] == phrase(story.first)
    turns = codraw(
        robot(), marker_paint_context(), story, lambda photo, _: np.minimum(photo, cross()), config=CONFIG, seed=0
    )
    assert all(turn.strokes[0] == 0 and np.array_equal(turn.before, turn.started) for turn in turns)


def test_film_strip_has_a_picture_for_each_turn() -> None:
    strip = film_strip([turn(paper(), cross(), 1), turn(cross(), cross(), 0)])
    assert all(len(pictures) == 2 for pictures in strip.values())
    assert (strip["robot adds"][0] == cross()).all() and (strip["person draws"][0] == paper()).all()
