"""One hidden effect of each family of causes is named among causes of all families; nothing is named without one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.strokes.fit import first_model, fit
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import Model, identity
from pentimento.diagnosis.strokes.modes import MODES
from pentimento.diagnosis.strokes.predict import predicted
from pentimento.diagnosis.strokes.problem import StrokeResult, stroke_problem
from pentimento.dynamics.strokes.mechanisms.backlash import Backlash
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.mechanisms.canvas_tilt import CanvasTilt
from pentimento.dynamics.strokes.mechanisms.curvature_width import CurvatureWidth
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.lens_distortion import LensDistortion
from pentimento.dynamics.strokes.mechanisms.orientation_width import OrientationWidth
from pentimento.dynamics.strokes.mechanisms.path_offset import PathOffset
from pentimento.dynamics.strokes.mechanisms.path_scale import PathScale
from pentimento.dynamics.strokes.mechanisms.speed_width import SpeedWidth
from pentimento.dynamics.strokes.mechanisms.tool_wear import ToolWear
from pentimento.dynamics.strokes.mechanisms.wet_mixing import WetMixing
from pentimento.dynamics.strokes.simulation import Mechanism
from studies.blind.decoys import draw_decoys
from studies.blind.strokes.collect import as_table, record_world
from studies.blind.strokes.design import view_of
from studies.blind.strokes.make import commands_of
from studies.blind.strokes.worlds import sketch_world
from tests.diagnosis.strokes.hidden import photographed, swayed

FAMILIES: tuple[type[Mechanism], ...] = (
    Backlash, BristleLag, CanvasTilt, CurvatureWidth, InkDepletion, LensDistortion, OrientationWidth, PathOffset,
    PathScale, SpeedWidth, ToolWear, WetMixing,
)  # fmt: skip
"""One cause of each family."""
SHEETS: dict[type[Mechanism], tuple[int, ...]] = {WetMixing: (0, 1, 2, 3)}
"""Sheets of the design where two of them would show a cause in too few strokes, that is paint in 14."""
NOISE = 0.01
"""Of a photograph's pixels, sRGB."""


def recorded(sheets: Sequence[int] = (0, 2)) -> tuple[Model, Measured]:
    """Strokes of some of six sheets (two: 56 strokes of 44 actions), and a plain stroke model of their tool."""
    sketch = sketch_world("none", 11, None, "round_brush")
    view = view_of(sketch.tool, fine=False)
    commands = [command for command in commands_of(sketch, view) if command.sheet in sheets]
    recording = record_world(
        sketch.with_strengths(()), 11, sketch.tool, palette_srgb=sketch.palette_srgb, commands=commands, view=view,
        disturbances=[],
    )  # fmt: skip
    measured = load_measured(as_table(recording, draw_decoys(len(commands), 11, None)))
    return fit(first_model(measured), measured), measured


@pytest.fixture(scope="module")
def session() -> tuple[Model, Measured]:
    return recorded()


def observed(model: Model, measured: Measured) -> Measured:
    """Photographs as the model has them, each stroke a little darker or paler than that, with noise."""
    rng = np.random.default_rng(0)
    before, after = measured.samples.before.numpy(), predicted(model, measured)
    darker = 1 + 0.05 * rng.standard_normal((len(measured), 1, 1, 1))
    return photographed(measured, before + darker * (after - before) + NOISE * rng.standard_normal(after.shape))


def diagnosed(strokes: Measured) -> StrokeResult:
    return diagnose(stroke_problem(strokes, FAMILIES, 0), seed=0, log=lambda line: None)


def names(result: StrokeResult) -> set[str]:
    return {finding.cause for finding in result.established}


@pytest.mark.timeout(900)
def test_one_hidden_effect_of_each_family_is_named(session: tuple[Model, Measured]) -> None:
    """The first quantity of each cause has its typical size."""
    named = {}
    for kind in FAMILIES:
        base, measured = recorded(SHEETS[kind]) if kind in SHEETS else session
        values = torch.zeros(len(kind.quantities), dtype=torch.float64)
        values[0] = kind.quantities[0].typical
        cause = kind(values, identity(kind, measured.context).reference)
        named[kind.cause] = names(diagnosed(observed(base.plus(cause), measured)))
    assert sum(named[cause] == {cause} for cause in named) >= len(named) - 1, named
    assert sum(len(found - {cause}) for cause, found in named.items()) <= 1, named


def test_nothing_is_named_where_nothing_is_hidden(session: tuple[Model, Measured]) -> None:
    result = diagnosed(observed(*session))
    assert not names(result) and not result.structure.unexplained
    assert result.floor is not None
    assert result.floor.interval[0] < result.extended_losses.mean() < result.floor.interval[1]


def test_effect_outside_the_vocabulary_is_named_by_mode_and_covariate(session: tuple[Model, Measured]) -> None:
    base, measured = session
    humidity = np.random.default_rng(3).normal(size=len(measured))
    amounts = np.zeros((len(measured), len(MODES)))
    amounts[:, MODES.index("width")] = 0.2 * humidity
    swaying, columns = swayed(base, measured, amounts)
    strokes = observed(swaying, columns)
    result = diagnosed(replace(strokes, covariates=measured.covariates | {"humidity": humidity}))
    assert not names(result)
    assert [(left.mode, left.covariate) for left in result.structure.unexplained[:1]] == [("width", "humidity")]
