"""The report's section on one tool: its learned stroke model and the errors on held-out strokes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from markupsafe import Markup

from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import at_least
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.dynamics.strokes.evaluation import StrokeScores
from pentimento.dynamics.strokes.resolution import Auto, check_sampling
from pentimento.dynamics.strokes.samples import StrokeSamples, load_samples
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters, read_parameters
from pentimento.report.figures import BLUE, Series, line_chart
from pentimento.report.files import incomplete, read_json
from pentimento.report.html import Album
from pentimento.report.stroke_sheet import choose, draw_sheet
from pentimento.report.templates import render
from pentimento.report.wording import comparison, decimal, percent, signed_mm

_MM = 1000.0
_COMMANDED_MM = 50.0  # length of the example that the table explains scales with
_NAMES = {"model": "Traj2Stroke", "polyline": "polyline", "blank": "no mark"}


@dataclass(frozen=True)
class StrokePictures:
    """How recorded strokes are shown."""

    shown: int
    """Held-out strokes of each tool, from the best prediction through the median to the worst."""
    path_points: int
    """Points to which a path is resampled for prediction."""
    pixels_per_m: float | Auto
    """Photographs of a higher resolution are averaged down to about this; auto: by line width and windows."""
    margin_m: float | Auto
    """Windows are trimmed to this much around the commanded path; auto likewise."""

    def __post_init__(self) -> None:
        if self.shown < 1:
            raise ValueError(f"shown is {self.shown}; show at least one stroke.")
        at_least(self, 2, "path_points")
        check_sampling(self)


@dataclass(frozen=True, eq=False)
class ToolInputs:
    """One tool: held-out strokes, the model and the baseline, and their scores."""

    name: str
    held_out: StrokeSamples
    model: Traj2StrokeParameters
    polyline: Traj2StrokeParameters
    """The constant-width pen of min MSE on the training strokes."""
    crisp: Traj2StrokeParameters
    """The one of max IoU."""
    scores: dict[str, dict[str, StrokeScores]]
    """[`held_out` or `training`][`model`, `polyline` or `blank`]."""
    counts: dict[str, int]
    """Rows: `training`, `held_out`, `quarantined`."""
    epochs: list[float]
    weighted_l1: list[float]
    own_frame: bool = False
    """Whether each path was recorded in its stroke's own frame: x along the stroke, y to its left."""


def read_tool(name: str, strokes: Path, weights: Path, config: StrokePictures) -> ToolInputs:
    """Read a tool's table of strokes and the folder of its trained model.

    Raises:
        ContractError: a file is missing or does not hold what it should.
    """
    table = read_table(strokes, CONTRACT).table
    samples = load_samples(table, config.path_points, config.pixels_per_m, config.margin_m)
    held_out_actions = torch.tensor(read_json(weights / "held_out_actions.json"), dtype=torch.int64)
    held_out = samples.pick(torch.isin(samples.action, held_out_actions))
    if len(held_out.path) == 0:
        raise ContractError(
            f"None of the actions in {weights / 'held_out_actions.json'} is in {strokes}; "
            "train the model on these strokes again."
        )
    metrics, curve = read_json(weights / "metrics.json"), read_json(weights / "curve.json")
    try:
        return ToolInputs(
            name=name,
            held_out=held_out,
            model=read_parameters(weights / "parameters.json"),
            polyline=read_parameters(weights / "polyline.json"),
            crisp=read_parameters(weights / "polyline_for_iou.json"),
            scores={
                part: {model: StrokeScores(**metrics[part][model]) for model in ("model", "polyline", "blank")}
                for part in ("held_out", "training")
            },
            counts={part: metrics["strokes"][part] for part in ("training", "held_out", "quarantined")},
            epochs=curve["epoch"],
            weighted_l1=curve["weighted_l1"],
            own_frame="frame" in table.column_names and "stroke" in table.column("frame").to_pylist(),
        )
    except (KeyError, TypeError) as error:
        raise incomplete(weights, error, "train_stroke_dynamics") from error


def tool_section(inputs: ToolInputs, shown: int, album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    strokes = choose(inputs.held_out, inputs.model, inputs.crisp, shown)
    model, polyline = inputs.scores["held_out"]["model"], inputs.scores["held_out"]["polyline"]
    return render(
        "report/tool.html",
        album=album,
        tool=inputs,
        shown=len(strokes),
        sheet=draw_sheet(strokes),
        gap=comparison(polyline.mse / model.mse, "smaller", "larger") if model.mse > 0 else "0, smaller than",
        parameter_rows=parameter_rows(inputs.model, own_frame=inputs.own_frame),
        width_mm=2 * inputs.polyline.thickness_at_contact_m * _MM,
        crisp_width_mm=2 * inputs.crisp.thickness_at_contact_m * _MM,
        score_rows=[_score_row(inputs, model, name) for model, name in _NAMES.items()],
        curve=line_chart(
            [Series("weighted L1", inputs.epochs, inputs.weighted_l1, BLUE)], "epoch", "weighted L1", (5.2, 3.2)
        ),
    )


def parameter_rows(parameters: Traj2StrokeParameters, *, own_frame: bool = False) -> list[tuple[str, ...]]:
    """Symbol, name, value with its unit and meaning of the parameters of Traj2Stroke (thesis 5.3.4).

    With ``own_frame``, x and y are those of each stroke.
    """
    along = ("along its direction (x)", "sideways (y)") if own_frame else ("across the canvas (x)", "up the canvas (y)")
    sides = (("ahead of", "behind"), ("to the left of", "to the right of"))
    sides = sides if own_frame else (("to the right of", "to the left of"), ("above", "below"))
    (m_x, m_y), (b_x, b_y) = parameters.scale, parameters.offset_m
    alpha, beta_mm = parameters.thickness_per_press, parameters.thickness_at_contact_m * _MM
    opacity = (
        f"On its path the mark covers {percent(parameters.opacity)} of what lies below. The thesis assumes "
        f"{percent(1.0)}."
    )
    rows = (
        ("<i>m</i><sub>x</sub>", "scale along x", f"{m_x:.3f}", _scaled(m_x, along[0])),
        ("<i>m</i><sub>y</sub>", "scale along y", f"{m_y:.3f}", _scaled(m_y, along[1])),
        ("<i>b</i><sub>x</sub>", "shift along x", signed_mm(b_x), _shifted(b_x, *sides[0])),
        ("<i>b</i><sub>y</sub>", "shift along y", signed_mm(b_y), _shifted(b_y, *sides[1])),
        ("<i>α</i>", "thickness per press", f"{alpha:.3f}\u00a0mm/mm", _pressed(alpha)),
        ("<i>β</i>", "thickness at contact", f"{beta_mm:.2f} mm".replace("-", "−"), _touched(alpha, beta_mm)),
        ("<i>c</i>", "softness", f"{parameters.softness:.3f}", _soft(parameters.softness)),
        ("<i>ρ</i>", "opacity", f"{parameters.opacity:.3f}", opacity),
    )
    return [(Markup(symbol), *rest) for symbol, *rest in rows]


def _score_row(inputs: ToolInputs, model: str, name: str) -> tuple[str, ...]:
    held_out, training = inputs.scores["held_out"][model], inputs.scores["training"][model]
    return name, f"{held_out.iou:.3f}", decimal(held_out.l1), decimal(held_out.mse), f"{training.iou:.3f}"


def _scaled(scale: float, direction: str) -> str:
    return f"A stroke commanded {_COMMANDED_MM:.0f} mm {direction} is {_COMMANDED_MM * scale:.1f} mm long."


def _shifted(shift_m: float, positive: str, negative: str) -> str:
    if abs(shift_m) * _MM < 0.005:
        return "The mark has the commanded position."
    side = positive if shift_m > 0 else negative
    return f"The mark lies {abs(shift_m) * _MM:.2f} mm {side} the commanded position."


def _pressed(alpha: float) -> str:
    return f"Each millimetre of press widens the mark by {2 * alpha:.2f} mm."


def _touched(alpha: float, beta_mm: float) -> str:
    if beta_mm > 0:
        return f"Light contact draws a line {2 * beta_mm:.2f} mm wide."
    return f"The mark widens only beyond a press of {-beta_mm / alpha:.2f} mm."


def _soft(softness: float) -> str:
    return (
        f"Half-way between path and rim, the coverage is {percent(0.5**softness)} of that on the "
        "path: 100\u00a0% is a hard edge, 50\u00a0% a linear decrease."
    )
