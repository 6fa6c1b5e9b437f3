"""The timing of replanning times what it says: iterations that move strokes down an objective."""

import numpy as np

from benchmarks.replanning import time_steps
from pentimento.planning.objectives import PrintObjective
from pentimento.planning.strokes.brush import Array
from pentimento.planning.strokes.scene import scene_with
from tests.bundle.line_brush import SIDE_M, LineBrush, paint_context


class Heard:
    """An objective that notes its values."""

    def __init__(self, target: Array) -> None:
        self.values: list[float] = []
        self._objective = PrintObjective(target, (1, 4))

    def __call__(self, image: Array) -> tuple[float, Array]:
        value, gradient = self._objective(image)
        self.values.append(value)
        return value, gradient


def test_every_iteration_is_timed_and_goes_on_from_the_last() -> None:
    before = paint_context()
    target = np.full((40, 40, 3), 0.6, np.float32)
    heard = Heard(target)
    scene = scene_with(LineBrush(), before.tool, (SIDE_M, SIDE_M), target)
    steps, start = time_steps(scene, before.planner, heard, 6, 12)
    ms = np.array(steps)
    assert ms.shape == (12, 2) and (ms > 0).all()
    assert start == heard.values[0]
    assert heard.values[-1] < heard.values[0]
