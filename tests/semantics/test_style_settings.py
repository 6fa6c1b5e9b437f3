"""The style term of a planner's objectives: configuration, first pass and effect on a plan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError, ImageError
from pentimento.planning.strokes.config import PRINT_ALONE, ObjectivesConfig, StyleConfig
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import objective_for
from pentimento.planning.strokes.target import fit_to_canvas, load_photograph
from pentimento.semantics.style import PictureStyle, style_of
from pipelines._config import load_section
from tests.planning.strokes.scenes import CONFIG, scene, unheard

STYLE = StyleConfig(0.05, "retina", "local", None)
SHAPE = (64, 96)
YAML = """
objectives:
  print_weight: 1
  semantic_weight: 0
  text: null
  style: {weight: 0.05, picture: retina, features: local, vgg16_weights: null}
"""


def read(tmp_path: Path, text: str) -> ObjectivesConfig:
    (tmp_path / "params.yaml").write_text(text)
    return load_section(tmp_path / "params.yaml", "objectives", ObjectivesConfig)


def test_objectives_section_gives_the_print_and_style_terms(tmp_path: Path) -> None:
    objectives = read(tmp_path, YAML)
    assert objectives == replace(PRINT_ALONE, style=STYLE)
    config = replace(CONFIG, objectives=objectives)
    style = style_of(config)
    assert style is not None
    target = PictureStyle(replace(STYLE, picture="chelsea"), 0).picture(SHAPE)
    task = replace(scene(), target=target, style=style)
    values = objective_for(task, config).values(target)
    assert values["print"] < 1e-12
    assert values["style"] > 0.1
    alone = replace(config, objectives=PRINT_ALONE)
    assert style_of(alone) is None
    own = style.picture(SHAPE)
    assert list(objective_for(task, alone).values(own)) == ["print"]
    # A picture is at no distance of its own style.
    assert objective_for(task, config)(own)[0] == pytest.approx(objective_for(task, alone)(own)[0])


def test_style_alone_starts_from_the_target() -> None:
    style = replace(PRINT_ALONE, print_weight=0.0, style=STYLE)
    start = replace(CONFIG, iterations_free=0, iterations_palette=0)
    white = np.ones((*SHAPE, 3), np.float32)
    task = replace(scene(), target=fit_to_canvas(load_photograph("coffee"), SHAPE).astype(np.float32))
    printed, _ = plan(white, task, 8, start, unheard)
    styled, _ = plan(white, replace(task, style=PictureStyle(STYLE, 0)), 8, replace(start, objectives=style), unheard)
    for one, other in zip(printed.arrays(), styled.arrays(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_rejects_style_objective_for_a_scene_without_style() -> None:
    with pytest.raises(ConfigError, match="objectives include a style, but the scene has none"):
        objective_for(scene(), replace(CONFIG, objectives=replace(PRINT_ALONE, style=STYLE)))


def test_style_objective_changes_the_plan() -> None:
    strong = replace(STYLE, weight=0.3)
    both = replace(CONFIG, objectives=replace(PRINT_ALONE, style=strong), iterations_palette=30, relocate_every=0)
    target = fit_to_canvas(load_photograph("coffee"), (80, 120)).astype(np.float32)
    large = replace(scene(), target=target, style=style_of(both))
    white = np.ones((80, 120, 3), np.float32)
    objective = objective_for(large, both)
    values = {}
    for name, config in {"print": replace(both, objectives=PRINT_ALONE), "both": both}.items():
        strokes, _ = plan(white, large, 30, config, unheard)
        values[name] = objective.values(render_plan(strokes, white, large))
    assert values["both"]["style"] < 0.9 * values["print"]["style"]
    assert values["both"]["print"] < 0.5 * objective.values(white)["print"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("print_weight: 1", "print_weight: -1", r"objectives: print_weight is -1\.0; it must be 0 or more"),
        ("weight: 0.05", "weight: 0", r"objectives\.style: weight is 0\.0; it must be above 0"),
        ("local", "resnet", r"objectives\.style\.features is 'resnet', expected 'local' or 'vgg16'"),
        ("local", "vgg16", r"objectives\.style: vgg16_weights is None while features is 'vgg16'"),
        ("weights: null", "weights: a.pth", r"vgg16_weights is 'a\.pth' while features is 'local'"),
    ],
)
def test_rejects_invalid_objectives(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        read(tmp_path, YAML.replace(old, new))


def test_rejects_objectives_without_any_term(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"print_weight and semantic_weight are 0, text and style are null"):
        read(tmp_path, "objectives: {print_weight: 0, semantic_weight: 0, text: null, style: null}")


def test_rejects_missing_style_files_by_name(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"no photograph 'no_such_style'"):
        PictureStyle(replace(STYLE, picture="no_such_style"), 0).picture(SHAPE)
    none = StyleConfig(1.0, "retina", "vgg16", str(tmp_path / "none.pth"))
    with pytest.raises(ConfigError, match=r"no VGG-16 weights at .*none\.pth"):
        PictureStyle(none, 0).objective(SHAPE)
