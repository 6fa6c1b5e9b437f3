"""Stroke planning, in paints and in ink, runs without the packages of the workshop."""

import subprocess
import sys

from pipelines._imports import ROOT

PLAN = """
import sys
for heavy in ("torch", "sklearn", "skimage", "pandas", "matplotlib", "onnxruntime"):
    sys.modules[heavy] = None  # an import of it is an ImportError
from dataclasses import replace
import numpy as np
from pentimento.contracts.errors import ConfigError, ImageError
from pentimento.planning.strokes.config import PRINT_ALONE, StyleConfig
from pentimento.planning.strokes.palette import PaletteChoice
from pentimento.planning.strokes.planner import plan
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import objective_for, scene_with
from pentimento.planning.strokes.target import load_photograph
from pentimento.robots.tools import load_tool
import pentimento.control.painter
from tests.bundle.line_brush import LineBrush, paint_context

blank, target = np.ones((40, 60, 3), np.float32), np.ones((40, 60, 3), np.float32)
target[10:30, 15:45] = [0.6, 0.1, 0.1]
paints = replace(
    paint_context().planner, palette=PaletteChoice("plan", 2, None, None), iterations_free=6, iterations_palette=6,
    relocate_every=3, relocate_share=0.2,
)
for name, config in (("round_brush", paints), ("marker", paint_context(6).planner)):
    tool = load_tool(name)
    scene = scene_with(LineBrush(), tool, (0.12, 0.08), target)
    strokes, palette = plan(blank, scene, 12, config, lambda *_: None)
    objective = objective_for(scene, config)
    assert objective(render_plan(strokes, blank, scene))[0] < 0.95 * objective(blank)[0], name
    assert len(strokes) == 12 and 1 <= len(palette) <= 2
styled = replace(config, objectives=replace(PRINT_ALONE, style=StyleConfig(0.1, "retina", "local", None)))
try:
    plan(blank, scene, 4, styled, lambda *_: None)
except ConfigError as error:
    assert "part of the workshop only" in str(error)
else:
    raise AssertionError("a style was planned without the networks that see it")
try:
    load_photograph("coffee")
except ImageError as error:
    assert "pentimento[train]" in str(error)
else:
    raise AssertionError("a sample photograph was there without scikit-image")
"""


def test_stroke_planning_needs_no_workshop_packages() -> None:
    done = subprocess.run([sys.executable, "-c", PLAN], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
