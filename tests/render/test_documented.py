"""The examples of docs/renderer.md run as they stand there, and do what the page says."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.colour import srgb_to_linear, to_float
from pentimento.contracts.images import read_image
from pentimento.render import PixelStrokes, render
from pipelines._imports import ROOT

EXAMPLES = re.findall(r"^```python\n(.*?)^```", (ROOT / "docs/renderer.md").read_text(), re.MULTILINE | re.DOTALL)


def ran(example: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(example, "docs/renderer.md", "exec"), names)
    return names


def test_five_lines_render_a_stroke_and_give_the_gradient_of_the_loss() -> None:
    """Checked by finite differences."""
    found = ran(EXAMPLES[0])
    assert len([line for line in EXAMPLES[0].splitlines() if line and "import" not in line]) <= 5
    image, strokes = found["image"], found["strokes"]
    assert image[0, 13, 30].max() < 0.05 and image[0, 0, 0].min() == 1.0

    def loss(points: np.ndarray) -> float:
        moved = PixelStrokes(points, *strokes[1:])
        return 0.5 * float(np.square(render(moved, np.ones((1, 48, 64, 3)))[0] - 0.5).sum())

    step = 1e-5
    for index in np.ndindex(strokes.points.shape):
        shift = np.zeros_like(strokes.points)
        shift[index] = step
        slope = (loss(strokes.points + shift) - loss(strokes.points - shift)) / (2 * step)
        assert found["gradients"].points[index] == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_the_picture_is_saved_as_rendered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = ran(EXAMPLES[0] + EXAMPLES[1])
    np.testing.assert_allclose(srgb_to_linear(to_float(read_image(Path("stroke.png")))), found["image"][0], atol=0.01)


def test_a_stroke_finds_its_target_by_gradient() -> None:
    found = ran(EXAMPLES[2])
    assert found["losses"][-1] < 0.02 * found["losses"][0]
    assert (found["points"] - found["goal"]).abs().max() < 0.5
