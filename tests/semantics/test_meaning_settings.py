"""The semantic and text terms of a planner's objectives: configuration, closed forms, gradient and effect on a plan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ConfigError
from pentimento.planning.strokes.config import PRINT_ALONE, ObjectivesConfig, PlannerConfig, TextConfig
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.relocate import without_useless
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import Scene, objective_for
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import EncoderMeaning
from pipelines._config import load_section
from tests.planning.strokes.scenes import CONFIG, scene, unheard

WORDS = "a red house"
SHAPE = (64, 96)
WHITE = np.ones((*SHAPE, 3), np.float32)
SUM = ObjectivesConfig(print_weight=1.0, semantic_weight=0.3, text=TextConfig(0.2, WORDS), style=None)
WORDS_ALONE = replace(PRINT_ALONE, print_weight=0.0, text=TextConfig(1.0, WORDS))


def seen(encoder: Encoder, views: int = 0) -> Scene:
    """A red square on white paper, with an encoder."""
    target = WHITE.copy()
    target[16:48, 30:66] = [0.6, 0.05, 0.05]
    return replace(scene(), target=target, meaning=EncoderMeaning(encoder, views, 0))


def with_objectives(objectives: ObjectivesConfig, iterations: int = 20) -> PlannerConfig:
    return replace(
        CONFIG, objectives=objectives, iterations_free=iterations, iterations_palette=iterations, relocate_every=0
    )


def read(tmp_path: Path, text: str) -> ObjectivesConfig:
    (tmp_path / "params.yaml").write_text(f"objectives: {text}")
    return load_section(tmp_path / "params.yaml", "objectives", ObjectivesConfig)


def test_each_term_has_its_weight(encoder: Encoder, tmp_path: Path) -> None:
    given = read(
        tmp_path, "{print_weight: 1, semantic_weight: 0.3, text: {weight: 0.2, words: a red house}, style: null}"
    )
    assert given == SUM
    task = seen(encoder)
    objective = objective_for(task, with_objectives(given))
    values = objective.values(WHITE)
    assert list(values) == ["print", "semantic", "text"]
    assert objective(WHITE)[0] == pytest.approx(values["print"] + 0.3 * values["semantic"] + 0.2 * values["text"])
    at_target = objective.values(task.target)
    assert at_target["print"] < 1e-12 and at_target["semantic"] < 1e-8
    srgb = torch.ones(1, 3, *SHAPE)
    cosine = float(encoder.embed_images(srgb)[0] @ encoder.embed_texts([WORDS])[0])
    assert values["text"] == pytest.approx(1 - cosine, abs=1e-4)


def test_gradient_of_the_sum_equals_finite_differences(encoder: Encoder) -> None:
    objective = objective_for(seen(encoder), with_objectives(SUM))
    rng = np.random.default_rng(0)
    image = rng.uniform(0.2, 0.8, (*SHAPE, 3)).astype(np.float32)
    _, gradient = objective(image)
    direction = np.sign(gradient)
    step = np.float32(1e-3)
    rise = (objective(image + step * direction)[0] - objective(image - step * direction)[0]) / (2 * step)
    assert rise == pytest.approx(float((gradient * direction).sum()), rel=0.02)


def test_semantic_term_lowers_the_semantic_objective_of_a_plan(encoder: Encoder) -> None:
    task = seen(encoder)
    both = replace(PRINT_ALONE, semantic_weight=0.3)
    objective = objective_for(task, with_objectives(both))
    values = {}
    for name, objectives in {"print": PRINT_ALONE, "both": both}.items():
        strokes, _ = plan(WHITE, task, 12, with_objectives(objectives), unheard)
        values[name] = objective.values(render_plan(strokes, WHITE, task))
    assert values["both"]["semantic"] < 0.9 * values["print"]["semantic"]
    assert values["both"]["print"] < objective.values(WHITE)["print"]


def test_words_alone_start_from_the_target_and_lower_the_text_objective(encoder: Encoder) -> None:
    task = seen(encoder)
    objective = objective_for(task, with_objectives(WORDS_ALONE))
    start, end = (
        objective(render_plan(plan(WHITE, task, 12, with_objectives(WORDS_ALONE, n), unheard)[0], WHITE, task))[0]
        for n in (0, 30)
    )
    assert end < start - 0.05
    printed, _ = plan(WHITE, task, 12, with_objectives(PRINT_ALONE, 0), unheard)
    assert start == pytest.approx(objective(render_plan(printed, WHITE, task))[0])


def test_no_stroke_is_called_useless_without_a_print_objective(encoder: Encoder) -> None:
    task, config = seen(encoder), with_objectives(WORDS_ALONE, 0)
    strokes, _ = plan(WHITE, task, 12, config, unheard)
    empty = replace(task, target=WHITE)  # for which every stroke does harm
    assert len(without_useless(strokes, WHITE, empty, config)) == len(strokes)
    assert len(without_useless(strokes, WHITE, empty, with_objectives(PRINT_ALONE))) < len(strokes)


def test_plans_repeat_with_the_seed_of_the_views(encoder: Encoder) -> None:
    one, other = (plan(WHITE, seen(encoder, 2), 6, with_objectives(SUM), unheard)[0] for _ in range(2))
    for mine, theirs in zip(one.arrays(), other.arrays(), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_rejects_meaning_without_an_encoder() -> None:
    for objectives in (replace(PRINT_ALONE, semantic_weight=0.1), WORDS_ALONE):
        with pytest.raises(ConfigError, match="the scene has no encoder"):
            objective_for(scene(), with_objectives(objectives))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{weight: 0, words: a}", r"objectives\.text: weight is 0\.0; it must be above 0"),
        ("{weight: 1, words: ' '}", r"objectives\.text: words is empty"),
    ],
)
def test_rejects_invalid_text_objectives(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        read(tmp_path, f"{{print_weight: 1, semantic_weight: 0, text: {text}, style: null}}")
