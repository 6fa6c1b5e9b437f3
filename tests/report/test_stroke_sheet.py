import numpy as np
import pytest
import torch

from pentimento.dynamics.strokes.evaluation import score_model
from pentimento.report.stroke_sheet import choose, predict_photos, stroke_scores
from pentimento.report.tools import ToolInputs


def test_strokes_are_ordered_from_the_best_prediction_to_the_worst(tool: ToolInputs) -> None:
    rows = choose(tool.held_out, tool.model, tool.polyline, 3)
    assert [row.label for row in rows] == ["best", "median", "worst"]
    ious = [row.iou[0] for row in rows]
    assert ious == sorted(ious, reverse=True)
    assert len(choose(tool.held_out, tool.model, tool.polyline, 50)) == len(tool.held_out.path)  # no row twice


def test_scores_of_single_strokes_average_to_the_model_s(tool: ToolInputs) -> None:
    iou, _ = stroke_scores(predict_photos(tool.model, tool.held_out), tool.held_out)
    assert float(iou.nanmean()) == pytest.approx(score_model(tool.model, tool.held_out).iou, rel=1e-5)


def test_strokes_without_ink_are_left_out_unless_there_are_no_others(tool: ToolInputs) -> None:
    one_blank = tool.held_out._replace(ink=tool.held_out.ink.clone())
    one_blank.ink[0] = False
    assert len(choose(one_blank, tool.model, tool.polyline, 9)) == len(tool.held_out.path) - 1
    all_blank = tool.held_out._replace(ink=torch.zeros_like(tool.held_out.ink))
    rows = choose(all_blank, tool.model, tool.polyline, 9)
    assert len(rows) == len(tool.held_out.path) and all(np.isnan(row.iou[0]) for row in rows)


def test_padding_is_cut_away_and_the_path_lies_on_its_stroke(tool: ToolInputs) -> None:
    for row in choose(tool.held_out, tool.model, tool.polyline, 3):
        assert row.before.min() > 0.5  # paper everywhere: padding is black
        column, line = np.round(row.path_px[len(row.path_px) // 2]).astype(int)
        assert row.after[line, column].mean() < 0.5 < row.before[line, column].mean()
