"""The report's section on one tool: what its model learned and how well it foretells strokes it has not seen."""

from __future__ import annotations

from html import escape

from pentimento.dynamics.strokes.evaluation import StrokeScores
from pentimento.report.figures import BLUE, Series, line_chart
from pentimento.report.html import Album, row, table
from pentimento.report.inputs import ToolInputs
from pentimento.report.parameters import parameter_table, polyline_sentence
from pentimento.report.stroke_sheet import choose, draw_sheet
from pentimento.report.wording import count, decimal, times, tool_name

_NAMES = {"model": "Traj2Stroke", "polyline": "polyline", "blank": "nothing happens"}


def tool_section(inputs: ToolInputs, shown: int, album: Album) -> str:
    """HTML of the section; its pictures go into the album."""
    name = escape(tool_name(inputs.name))
    strokes = choose(inputs.held_out, inputs.model, inputs.crisp, shown)
    sheet = album.plot(
        f"strokes_{inputs.name}.png",
        draw_sheet(strokes),
        f"A row for each of {count(len(strokes), 'stroke')} of the {tool_name(inputs.name)}: photographs before and "
        "after, the predictions of Traj2Stroke and of the polyline, and maps of their errors.",
        f"Strokes that the model has not seen, from the best foretold (by IoU) through the median to the worst; "
        f"{'all at' if len(strokes) > 1 else 'at'} one scale, the dark bar is 10&nbsp;mm. <b>Before</b>: the canvas, "
        "with the commanded path in ochre and a dot where it starts. <b>After</b>: the photograph of the stroke. "
        "<b>Traj2Stroke</b> and <b>polyline</b>: what the two models say the photograph will be (the polyline "
        "fitted for the IoU). <b>|error|</b>: how "
        "far each is off, sRGB in [0, 1], pale where right and dark where wrong.",
    )  # fmt: skip
    curve = album.plot(
        f"training_{inputs.name}.png",
        line_chart(
            [Series("weighted L1", inputs.epochs, inputs.weighted_l1, BLUE)],
            "epoch",
            "weighted L1",
            (5.2, 3.2),
        ),
        f"Curve of the training loss of the {tool_name(inputs.name)}, from {decimal(inputs.weighted_l1[0])} to "
        f"{decimal(inputs.weighted_l1[-1])}.",
        "The training loss: mean absolute difference between prediction and photograph, in which a pixel under the "
        "new stroke weighs more than a blank one (thesis 5.3.4).",
    )  # fmt: skip
    return f"""<section id="tool-{escape(inputs.name)}">
<h3>The {name}</h3>
<p>{tool_summary(inputs)}</p>
{sheet}
{parameter_table(inputs.model, name)}
<p>{polyline_sentence(inputs.polyline, inputs.crisp)}</p>
{row([_score_table(inputs), curve])}
</section>"""


def tool_summary(inputs: ToolInputs) -> str:
    """How well the model foretells strokes, in words that stay true where it is the worse one."""
    counts, scores = inputs.counts, inputs.scores["held_out"]
    model, polyline = scores["model"], scores["polyline"]
    quarantined = (
        f" ({count(counts['quarantined'], 'row')} of the table broke the contract and were left out)"
        if counts["quarantined"]
        else ""
    )
    ahead = "more" if model.iou >= polyline.iou else "less"
    factor = times(polyline.mse / model.mse, "smaller", "larger") if model.mse > 0 else "nil, smaller"
    than = "as" if factor == "as large" else "than"
    return (
        f"The model learned from {count(counts['training'], 'stroke')} and was tested on "
        f"{counts['held_out']} others{quarantined}. On those, predicted and photographed ink overlap by "
        f"{model.iou:.3f} (IoU; 1 is perfect), {abs(model.iou - polyline.iou):.3f} {ahead} than with the polyline; "
        f"its mean squared error is {factor} {than} the polyline’s."
    )


def _score_table(inputs: ToolInputs) -> str:
    rows = []
    for model, name in _NAMES.items():
        held_out, training = inputs.scores["held_out"][model], inputs.scores["training"][model]
        rows.append((name, *_cells(held_out), f"{training.iou:.3f}"))
    caption = (
        f"Scores on the {count(inputs.counts['held_out'], 'held-out stroke')}: IoU higher is better, L1 and MSE lower. "
        "The last column is the IoU on the training strokes; far above the first, it would mean that the "
        "model had learned them by heart."
    )
    return table(("model", "IoU", "L1", "MSE", "IoU, training"), rows, caption)


def _cells(scores: StrokeScores) -> tuple[str, str, str]:
    return f"{scores.iou:.3f}", decimal(scores.l1), decimal(scores.mse)
