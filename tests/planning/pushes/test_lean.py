"""Push planning runs without the packages of the workshop."""

import subprocess
import sys

from pipelines._imports import ROOT

SCULPT = """
import sys
for heavy in ("torch", "sklearn", "skimage", "pandas", "matplotlib", "onnxruntime", "trimesh"):
    sys.modules[heavy] = None  # an import of it is an ImportError
import numpy as np
import pentimento.control.sculptor
from pentimento.planning.pushes.goal import GoalSettings, fit_goal
from pentimento.planning.objectives import ClayObjective
from pentimento.planning.pushes.plan import plan
from pentimento.planning.pushes.rollout import EnsembleRollout
from tests.planning.pushes.clay import WINDOW_M, PressedClay, flat
from tests.planning.pushes.settings import CONFIG, REACH

bar = np.zeros(flat().shape)
bar[20:28, 10:38] = -1.0
goal = fit_goal(bar, flat(), GoalSettings(1.0, 10.0, 0.01, 0.5, 0.003, 0.1)).height_m
foresight = EnsembleRollout([PressedClay()], ClayObjective(goal, WINDOW_M, CONFIG.weights), 0.0)
values = plan(flat(), foresight, REACH, config=CONFIG, count=4, item=(0,)).values
assert values[-1] < 0.7 * values[0], values
"""


def test_push_planning_needs_no_workshop_packages() -> None:
    subprocess.run([sys.executable, "-W", "error", "-c", SCULPT], cwd=ROOT, check=True, timeout=100)
