"""The wheel without extras paints: what a robot's computer installs has no torch.

Needs the package index (like the environment itself); without it this test fails rather than skips.
"""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

PAINT = """
import sys
from importlib.util import find_spec
import numpy as np
from pentimento.contracts.covariates import fresh_memory
from pentimento.contracts.plan import PlannedStroke
from pentimento.render import PixelStrokes, render, render_backward
from pentimento.robots.motion import timed_path
from pentimento.robots.tools import load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.control.execute import Session, execute
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world

tool = load_tool("round_brush")
studio = Studio(load_world("round_brush"), seed=1)
robot = GuardedRobot(VirtualRobot(studio), envelope_for(tool, studio.canvas_size_m))
blue = np.array([0.1, 0.2, 0.7])
line = np.linspace([0.10, 0.10, -0.001, 0.0], [0.13, 0.12, -0.001, 0.0], 16)  # x_m, y_m, z_m, yaw_rad
path = timed_path(line, tool.speed_m_s)
stroke = PlannedStroke(path=path, color_srgb=blue, dip=True)
before = robot.photo().frame
memory = fresh_memory(studio.canvas_size_m)
_, measured = execute(
    robot, tool, [stroke, stroke], palette_srgb=blue[None], memory=memory, session=Session("clean", robot.clock_s)
)
after = robot.photo().frame
assert len(measured) == 2 and measured[0].shape == path.shape
assert np.abs(after.astype(float) - before).max() > 60, "the stroke must show in the photo"

points = np.linspace([8.0, 8.0], [24.0, 20.0], 32)[None, None]  # [B, S, N, 2] pixels
radius, density, softness = np.full((1, 1, 32), 3.0), np.ones((1, 1, 32)), np.zeros((1, 1, 32))
strokes = PixelStrokes(points, radius, density, softness, np.zeros((1, 1, 3)))
image, fragments = render(strokes, np.ones((1, 32, 32, 3)))
assert image[0, 14, 16, 0] < 0.1 and image[0, 30, 2, 0] == 1.0
gradients = render_backward(strokes, fragments, image)
assert np.isfinite(gradients.points).all()

assert "torch" not in sys.modules
assert not any(find_spec(name) for name in ("torch", "mlflow", "dvc", "pandas")), "no hidden need"
"""


def run(*command: str | Path, cwd: Path) -> None:
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"


@pytest.mark.timeout(300)
def test_the_wheel_without_extras_paints_without_torch(tmp_path: Path) -> None:
    python = tmp_path / "clean/bin/python"
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")
    run(*pip, "wheel", "--no-deps", "--wheel-dir", tmp_path, ROOT, cwd=tmp_path)
    (wheel,) = tmp_path.glob("pentimento-*.whl")
    run(sys.executable, "-m", "venv", "--without-pip", tmp_path / "clean", cwd=tmp_path)
    constraints = ROOT / "constraints.txt"
    run(*pip, "--python", python, "install", "--no-compile", "-c", constraints, wheel, cwd=tmp_path)
    run(python, "-I", "-W", "error", "-c", PAINT, cwd=tmp_path)
    run(python.with_name("pentimento"), "doctor", cwd=tmp_path)  # nothing that a robot's computer needs is missing
