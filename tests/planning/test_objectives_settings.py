"""Which objectives are summed is read from params.yaml; what makes no sense is a sentence."""

from pathlib import Path

import pytest
import torch

from pentimento.contracts.errors import ConfigError, ImageError
from pentimento.planning.objectives.settings import (
    ObjectivesConfig,
    StyleConfig,
    build_objective,
    first_pass_target,
    load_style_picture,
)
from pipelines._config import load_section

STYLE = StyleConfig(0.05, "retina", "local", None)
SHAPE = (64, 96)
YAML = """
objectives:
  print_weight: 1
  style: {weight: 0.05, picture: retina, features: local, vgg16_weights: null}
"""


def read(tmp_path: Path, text: str) -> ObjectivesConfig:
    (tmp_path / "params.yaml").write_text(text)
    return load_section(tmp_path / "params.yaml", "objectives", ObjectivesConfig)


def test_the_section_is_read_and_its_sum_has_its_terms(tmp_path: Path) -> None:
    config = read(tmp_path, YAML)
    assert config == ObjectivesConfig(1.0, STYLE)
    style = load_style_picture(STYLE, SHAPE)
    target = load_style_picture(StyleConfig(1.0, "chelsea", "local", None), SHAPE)
    values = build_objective(config, target, style, (1, 4), 0).values(target)
    assert float(values["print"]) < 1e-12
    assert float(values["style"]) > 0.1
    total = float(build_objective(config, target, style, (1, 4), 0)(style))
    alone = build_objective(ObjectivesConfig(1.0, None), target, None, (1, 4), 0)
    assert list(alone.values(style)) == ["print"]
    assert total == pytest.approx(float(alone(style)))  # a picture is at no distance of its own style


def test_the_first_pass_copies_the_style_picture_where_nothing_else_composes() -> None:
    target, style = torch.zeros(*SHAPE, 3), torch.ones(*SHAPE, 3)
    assert first_pass_target(ObjectivesConfig(0.0, STYLE), target, style) is style
    assert first_pass_target(ObjectivesConfig(1.0, STYLE), target, style) is target
    assert first_pass_target(ObjectivesConfig(1.0, None), target, None) is target


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
def test_what_makes_no_sense_is_a_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        read(tmp_path, YAML.replace(old, new))


def test_no_objective_is_no_plan(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"print_weight is 0\.0 and style is null|print_weight is 0 and style is null"
    ):
        read(tmp_path, "objectives: {print_weight: 0, style: null}")


def test_files_that_are_not_there_are_named(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"no photograph 'no_such_style'"):
        load_style_picture(StyleConfig(1.0, "no_such_style", "local", None), SHAPE)
    config = ObjectivesConfig(0.0, StyleConfig(1.0, "retina", "vgg16", str(tmp_path / "none.pth")))
    with pytest.raises(ConfigError, match=r"no VGG-16 weights at .*none\.pth"):
        build_objective(config, torch.zeros(*SHAPE, 3), torch.zeros(*SHAPE, 3), (1,), 0)
    with pytest.raises(ValueError, match="has no picture"):
        build_objective(ObjectivesConfig(1.0, STYLE), torch.zeros(*SHAPE, 3), None, (1,), 0)
