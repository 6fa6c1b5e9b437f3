"""What the report says of a painting, in sentences that stay true whichever way the results go. All are HTML."""

from __future__ import annotations

from html import escape

import numpy as np

from pentimento.report.inputs import PaintingInputs
from pentimento.report.wording import count, decimal, lowered, percent, times, tool_name


def summary(inputs: PaintingInputs) -> str:
    """The painting in a paragraph of numbers."""
    tool, paints = tool_of(inputs), len(inputs.palette_srgb)
    return (
        f"<p><b>{escape(inputs.setting.capitalize())}.</b> With the {tool}"
        f"{f' and {paints} paints' if paints > 1 else ''}, the robot made "
        f"{count(len(inputs.executed.strokes), 'stroke')}. After every {batch(inputs)} it looked at the canvas and "
        f"planned the rest anew, which <b>{lowered('the final error', inputs.lowered_by)}</b> against painting the "
        "first plan blindly. "
        f"The model that it had learned of the {tool} foretold that blind painting with a mean squared error "
        f"{_gap(inputs)} that of the strongest trivial model, a line of constant width.</p>"
    )  # fmt: skip


def introduction(inputs: PaintingInputs) -> str:
    """What was done."""
    return (
        f"{count(len(inputs.executed.strokes), 'stroke')} with the {tool_of(inputs)}; a photograph and a new plan "
        f"of what was left after every {batch(inputs)}."
    )


def target(inputs: PaintingInputs) -> str:
    """What the target is."""
    if np.array_equal(inputs.target, inputs.photograph):
        return "what the planner aims at: paint can be mixed to its colours, so it is the photograph itself"
    return "what the planner aims at: the photograph in tones that the tool’s own ink can reach"


def deviation(inputs: PaintingInputs) -> str:
    """What the curves of Figure 4.11 show."""
    ended = (inputs.deviation_with[-1], inputs.deviation_without[-1])
    words = "farther from" if ended[0] > ended[1] else "nearer to" if ended[0] < ended[1] else "as near to"
    than = "as" if words == "as near to" else "than"
    return (
        "Deviation from the first plan (thesis Figure 4.11): mean squared difference between the finished picture as "
        "foretold at the start and as foretold after each batch. Without replanning it is only what reality does to "
        f"the plan; with replanning it also holds what the robot changed its mind about. At {decimal(ended[0])}, the "
        f"painting with replanning ended {words} the first plan {than} the one without, at {decimal(ended[1])}."
    )  # fmt: skip


def sim2real(inputs: PaintingInputs) -> str:
    """How large the sim2real gap is."""
    mse = inputs.sim2real_mse
    share = f", and {percent(mse['model'] / mse['blank'])} of that of a blank canvas" if mse["blank"] > 0 else ""
    return (
        "The sim2real gap (thesis Figure 4.10) is the mean squared difference between what was foretold and what "
        f"the robot then painted, without replanning. The learned model’s gap is {_gap(inputs)} the polyline’s{share}."
    )


def planning(inputs: PaintingInputs) -> str:
    """What the curve of the planning loss shows."""
    first, last = inputs.objective[0], inputs.objective[-1]
    return (
        "Planning: the objective (print, thesis 4.3, and style where that has a weight) while the first plan was "
        "optimised. It jumps where strokes are added or relocated, where it is taken at half or full resolution, and "
        "where colours become paints; where the plan leaves room for mishaps, every iteration sees others. "
        f"It went from {decimal(first)} to {decimal(last)} in {count(len(inputs.objective), 'iteration')}."
    )  # fmt: skip


def batch(inputs: PaintingInputs) -> str:
    """How many strokes lie between two photographs."""
    strokes = inputs.made[1] - inputs.made[0] if len(inputs.made) > 1 else len(inputs.executed.strokes)
    return count(round(strokes), "stroke")


def tool_of(inputs: PaintingInputs) -> str:
    """The tool's name in words."""
    return escape(tool_name(inputs.executed.header.tool))


def _gap(inputs: PaintingInputs) -> str:
    factor = times(inputs.sim2real_factor, "smaller", "larger")
    return f"<b>{factor}</b> {'as' if factor == 'as large' else 'than'}"
