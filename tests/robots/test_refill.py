"""When a tool is dipped: by the tool's count, and by the diagnosed depletion of its load."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pentimento.contracts.covariates import StrokeEvent, advance, fresh_memory
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.plan import PlannedStroke
from pentimento.dynamics.strokes.extended import StrokeModel, base_model
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.planned import TorchBrush, depletion_of
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from pentimento.planning.strokes.bezier import Strokes, with_color
from pentimento.planning.strokes.brush import Span, StrokeTiming
from pentimento.planning.strokes.memory import Start, planned_covariates
from pentimento.robots.motion import timed_path
from pentimento.robots.refill import Depletion, needs_dip, too_long, with_dips
from pentimento.robots.tools import Tool, load_tool

CANVAS_M = (0.3, 0.2)
RED, BLUE = np.array([0.8, 0.1, 0.1]), np.array([0.1, 0.1, 0.8])
BRUSH = replace(load_tool("round_brush"), max_fade=0.2)
FREE = replace(BRUSH, max_strokes_per_dip=1000)
START = fresh_memory(CANVAS_M)
LOSSES = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)


def stroke(length_m: float, color: np.ndarray = RED, dip: bool = False) -> PlannedStroke:
    places = np.zeros((16, 4))
    places[:, 0] = np.linspace(0.1, 0.1 + length_m, 16)
    places[:, 1], places[:, 2] = 0.1, -0.001
    return PlannedStroke(timed_path(places, 0.06), color, dip)


def strokes(seed: int, count: int = 40) -> list[PlannedStroke]:
    """Of random lengths, in red and blue."""
    rng = np.random.default_rng(seed)
    return [stroke(rng.uniform(0.008, 0.055), RED if rng.random() < 0.8 else BLUE) for _ in range(count)]


def dips(planned: list[PlannedStroke], tool: Tool, depletion: Depletion | None) -> list[bool]:
    return [decided.dip for decided in with_dips(planned, tool, START, depletion)]


def per_metre(loss: float) -> Depletion:
    return Depletion("ink_since_reload_m", loss)


def fades(planned: list[PlannedStroke], tool: Tool, depletion: Depletion) -> list[float]:
    """Share of darkness that is missing at the end of each stroke, as it is executed."""
    memory, found = START, []
    for decided in with_dips(planned, tool, START, depletion):
        memory = advance(memory, StrokeEvent(decided.path, 0.0, decided.dip, decided.color_srgb))
        found.append(1 - np.exp(-depletion.loss * memory.ink_since_reload_m))
    return found


def test_without_depletion_the_tools_count_decides() -> None:
    planned = [stroke(0.03)] * 9
    assert dips(planned, BRUSH, None) == [i % BRUSH.strokes_per_dip == 0 for i in range(9)]
    assert dips(planned, FREE, None) == dips(planned, BRUSH, None)


def test_a_load_that_does_not_run_out_lasts_until_the_limit() -> None:
    planned = [stroke(0.03)] * 9
    for loss in (0.0, -1.0, 1e-9):
        assert dips(planned, BRUSH, per_metre(loss)) == dips(planned, BRUSH, None)
        assert sum(dips(planned, FREE, per_metre(loss))) == 1


@pytest.mark.parametrize("tool", [BRUSH, FREE])
@pytest.mark.parametrize("seed", range(4))
def test_stronger_depletion_needs_no_fewer_dips(tool: Tool, seed: int) -> None:
    counts = [sum(dips(strokes(seed), tool, per_metre(loss))) for loss in LOSSES]
    assert counts == sorted(counts) and counts[-1] > counts[0]


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("seed", range(4))
def test_no_stroke_ends_with_a_load_below_the_threshold(loss: float, seed: int) -> None:
    load_m = per_metre(loss).load_m(0.2)
    planned = [one for one in strokes(seed) if one.path[-1, 1] - 0.1 <= load_m]
    assert all(fade <= 0.2 + 1e-9 for fade in fades(planned, FREE, per_metre(loss)))


def test_no_dip_comes_early() -> None:
    """Each dip within a colour is one without which its stroke would fade too far."""
    depletion, memory, seen = per_metre(2.0), START, 0
    for decided in with_dips(strokes(1), FREE, START, depletion):
        if decided.dip and (memory.last_color_srgb == decided.color_srgb).all():
            assert depletion.fade(decided.path, memory) > 0.2
            seen += 1
        memory = advance(memory, StrokeEvent(decided.path, 0.0, decided.dip, decided.color_srgb))
    assert seen > 3


def test_the_limit_of_the_tool_holds_whatever_is_predicted() -> None:
    limited = replace(BRUSH, max_strokes_per_dip=6)
    assert np.flatnonzero(dips([stroke(0.01)] * 13, limited, per_metre(1e-6))).tolist() == [0, 6, 12]


def test_a_load_counted_in_strokes_fades_by_stroke() -> None:
    """exp(-0.1 n) falls below 0.8 at n = 3."""
    by_stroke = Depletion("since_reload", 0.1)
    assert np.flatnonzero(dips([stroke(0.03)] * 7, FREE, by_stroke)).tolist() == [0, 3, 6]
    assert too_long([stroke(0.05)], FREE, by_stroke) == ""


def test_a_stroke_too_long_for_a_load_is_dipped_for_and_told() -> None:
    planned, soon = [stroke(0.02), stroke(0.05), stroke(0.02)], per_metre(8.0)
    assert dips(planned, FREE, soon) == [True, True, True]
    assert too_long(planned, FREE, soon) == (
        "1 stroke is too long for one load of paint: a fresh load loses 20% of its darkness within 28 mm, and the "
        "longest stroke has 50 mm; lower the maximum of stroke_length of the round_brush to avoid that."
    )
    assert too_long(planned, FREE, per_metre(1.0)) == too_long(planned, FREE, None) == ""
    assert too_long(planned, replace(FREE, max_fade=None), soon) == ""


def test_own_ink_is_never_dipped() -> None:
    marker = replace(load_tool("marker"), max_fade=0.1)
    assert not needs_dip(marker, stroke(0.05, dip=True), START, per_metre(100.0))
    assert too_long([stroke(0.05)], marker, per_metre(100.0)) == ""


def model(loss: float) -> StrokeModel:
    fading = InkDepletion(torch.tensor([0.6 * loss, 0.4 * loss]) / 2, {"column": 0.0, "since": 0.5})
    return StrokeModel(
        Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 2e-3, 0.2, 0.9), (fading,),
        {"ink_since_reload_m": Span(0.0, 0.1, 1.0)}, StrokeTiming(3.0, 5.0),
    )  # fmt: skip


def row(count: int) -> Strokes:
    """Red ones of 40 mm, one above the other."""
    middle = np.stack([np.full(count, 0.1), 0.02 + 0.01 * np.arange(count)], axis=1)
    zeros = np.zeros(count)
    arrays = (middle, zeros, np.full(count, 0.04), zeros, np.full((count, 3), 1e-3), np.zeros((count, 3)))
    bezier = Strokes(*(array.astype(np.float32) for array in arrays))
    return with_color(bezier, np.tile(RED.astype(np.float32), (count, 1)))


def test_the_loss_is_that_of_the_models_marks() -> None:
    """Density times width of a mark at its start, after 0.3 m and fresh."""
    brush, one = TorchBrush(model(2.0), BRUSH, 16), row(1)
    dark = []
    for used_m in (0.0, 0.3):
        marks, _ = brush.marks(one, {"ink_since_reload_m": np.full(1, used_m, np.float32)})
        dark.append(float(marks.density[0, 0] * marks.radius_m[0, 0]))
    depletion = depletion_of(brush.model)
    assert depletion is not None and depletion.loss == pytest.approx(2.0)
    assert dark[1] / dark[0] == pytest.approx(np.exp(-depletion.loss * 0.3), rel=1e-4)
    assert depletion_of(base_model(brush.model.parameters)) is None


def test_the_planner_dips_where_the_executor_does() -> None:
    planned = row(12)
    for loss in LOSSES:
        brush = TorchBrush(model(loss), FREE, 16)
        known = planned_covariates(planned, FREE, brush, Start(START, 0.0, 0), names=["since_reload"])
        executed = dips(planned.planned(FREE, 16), FREE, brush.depletion)
        assert (known["since_reload"] == 0).tolist() == executed


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("max_fade = 0.0", "a share above 0 and below 1"),
        ("max_fade = 1.0", "a share above 0 and below 1"),
        ("max_strokes_per_dip = 3", r"strokes_per_dip \(4\) or more"),
    ],
)
def test_a_bad_limit_is_refused(line: str, reason: str, tmp_path: Path) -> None:
    from pentimento.robots import tools

    text = Path(tools.__file__).with_name("tools").joinpath("round_brush.toml").read_text(encoding="utf-8")
    key = line.split(" ")[0]
    file = tmp_path / "brush.toml"
    file.write_text(re.sub(rf"^{key} = .*\n", "", text, flags=re.MULTILINE) + line + "\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=reason):
        load_tool(file)
