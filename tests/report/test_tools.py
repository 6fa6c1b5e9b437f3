from dataclasses import replace

from pentimento.report.inputs import ToolInputs
from pentimento.report.tools import tool_summary


def test_scores_are_compared_with_the_polyline_s(tool: ToolInputs) -> None:
    text = tool_summary(tool)
    assert "learned from 3 strokes and was tested on 3 others" in text and "quarantin" not in text
    assert "0.200 more than with the polyline" in text and "2.50 times smaller than the polyline’s" in text


def test_a_model_worse_than_the_polyline_is_called_so(tool: ToolInputs) -> None:
    held_out = tool.scores["held_out"]
    swapped = held_out | {"model": held_out["polyline"], "polyline": held_out["model"]}
    text = tool_summary(replace(tool, scores=tool.scores | {"held_out": swapped}))
    assert "0.200 less than with the polyline" in text and "2.50 times larger than the polyline’s" in text


def test_rows_that_were_left_out_are_counted(tool: ToolInputs) -> None:
    assert "1 row of the table broke the contract" in tool_summary(
        replace(tool, counts=tool.counts | {"quarantined": 1})
    )
