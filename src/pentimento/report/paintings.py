"""The report's section on one painting: plan, execution, sim-to-real gap and the effect of replanning."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import encode_png, read_image
from pentimento.contracts.plan import Plan, read_plan
from pentimento.report.figures import (
    BLUE,
    OCHRE,
    Series,
    difference,
    difference_maps,
    line_chart,
    stroke_lines,
    time_lapse,
)
from pentimento.report.files import incomplete, read_bytes, read_json
from pentimento.report.html import Album, bar
from pentimento.report.templates import render
from pentimento.report.wording import comparison, decimal, percent, tool_name

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_ROWS = {
    "blank": "blank canvas",
    "plan": "plan (predicted)",
    "without_replanning": "painting without replanning",
    "with_replanning": "painting with replanning",
}


@dataclass(frozen=True, eq=False)
class PaintingInputs:
    """One setting: target, predictions and executed paintings. Pictures are sRGB uint8 [H, W, 3]."""

    setting: str
    photograph: Image
    target: Image
    plan: Image
    polyline: Image
    """The same plan as predicted by the baseline."""
    without: Image
    with_replanning: Image
    frames: list[Image]
    """The canvas before the first stroke and after every batch, with replanning."""
    executed_strokes: list[float]
    """Strokes executed at each entry of the two deviations."""
    deviation_with: list[float]
    deviation_without: list[float]
    iterations: list[float]
    objective: list[float]
    palette_srgb: FloatArray
    executed: Plan
    plan_svg: bytes
    error: dict[str, float]
    """[`blank`, `plan`, `without_replanning` or `with_replanning`] against the target."""
    lowered_by: float
    """Fraction by which replanning lowers the final error; negative where it raises it."""
    pixel_mse: dict[str, float]
    sim2real_mse: dict[str, float]
    """[`model`, `polyline` or `blank`] against the painting without replanning."""
    sim2real_factor: float


def read_painting(setting: str, folder: Path) -> PaintingInputs:
    """Read the folder that the stage `paint` wrote for a setting.

    Raises:
        ContractError, ImageError: a file is missing or does not hold what it should.
    """
    metrics, curve = read_json(folder / "metrics.json"), read_json(folder / "curve.json")
    deviation = read_json(folder / "deviation.json")
    frames = sorted((folder / "frames").glob("*.png"))
    if not frames:
        raise ContractError(f"{folder / 'frames'} holds no photograph; run the stage paint again.")
    try:
        return PaintingInputs(
            setting=setting,
            photograph=read_image(folder / "photograph.png"),
            target=read_image(folder / "target.png"),
            plan=read_image(folder / "plan.png"),
            polyline=read_image(folder / "polyline.png"),
            without=read_image(folder / "painting_without.png"),
            with_replanning=read_image(folder / "painting_with.png"),
            frames=[read_image(frame) for frame in frames],
            executed_strokes=deviation["strokes"],
            deviation_with=deviation["with"],
            deviation_without=deviation["without"],
            iterations=curve["iteration"],
            objective=curve["objective"],
            palette_srgb=np.asarray(read_json(folder / "palette.json"), dtype=np.float64).reshape(-1, 3),
            executed=read_plan(folder / "executed_with.jsonl"),
            plan_svg=read_bytes(folder / "plan.svg"),
            error={part: metrics["error"][part] for part in ("blank", "plan", "without_replanning", "with_replanning")},
            lowered_by=metrics["replanning_lowers_error_by"],
            pixel_mse={part: metrics["pixel_mse"][part] for part in ("without_replanning", "with_replanning")},
            sim2real_mse={part: metrics["sim2real_mse"][part] for part in ("model", "polyline", "blank")},
            sim2real_factor=metrics["sim2real_factor"],
        )
    except (KeyError, TypeError) as error:
        raise incomplete(folder, error, "paint") from error


def opening(inputs: PaintingInputs, frame_ms: int, album: Album) -> Markup:
    """The page's opening: photograph, painting and time-lapse of one painting."""
    return render(
        "report/opening.html",
        album=album,
        painting=inputs,
        photograph=encode_png(inputs.photograph),
        with_replanning=encode_png(inputs.with_replanning),
        strokes=len(inputs.executed.strokes),
        **_lapse(inputs, frame_ms),
    )


def summary(inputs: PaintingInputs) -> Markup:
    """The painting in one paragraph."""
    return render("report/summary.html", painting=inputs, **_facts(inputs))


def painting_section(inputs: PaintingInputs, frame_ms: int, album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    mse = inputs.sim2real_mse
    maps = {
        f"Traj2Stroke: MSE {decimal(mse['model'])}": difference(inputs.plan, inputs.without),
        f"polyline: MSE {decimal(mse['polyline'])}": difference(inputs.polyline, inputs.without),
        f"blank canvas: MSE {decimal(mse['blank'])}": difference(inputs.frames[0], inputs.without),
    }
    ended = inputs.deviation_with[-1], inputs.deviation_without[-1]
    order = "farther from" if ended[0] > ended[1] else "closer to" if ended[0] < ended[1] else "as close to"
    return render(
        "report/painting.html",
        album=album,
        painting=inputs,
        photograph=encode_png(inputs.photograph),
        target=encode_png(inputs.target),
        target_is_photograph=np.array_equal(inputs.target, inputs.photograph),
        plan=encode_png(inputs.plan),
        polyline=encode_png(inputs.polyline),
        without=encode_png(inputs.without),
        with_replanning=encode_png(inputs.with_replanning),
        palette=_palette(inputs),
        error_rows=_error_rows(inputs),
        deviation_chart=_deviation_chart(inputs),
        deviation_with=ended[0],
        deviation_without=ended[1],
        deviation_in_words=f"{order} the first plan {'as' if order == 'as close to' else 'than'}",
        difference_chart=difference_maps(maps, "difference, sRGB"),
        difference_titles=list(maps),
        strokes_chart=stroke_lines(inputs.executed),
        planning_chart=_planning_chart(inputs),
        **_facts(inputs),
        **_lapse(inputs, frame_ms),
    )


def _facts(inputs: PaintingInputs) -> dict[str, Any]:
    strokes, executed = len(inputs.executed.strokes), inputs.executed_strokes
    return {
        "strokes": strokes,
        "tool": tool_name(inputs.executed.header.tool),
        "replan_every": round(executed[1] - executed[0] if len(executed) > 1 else strokes),
        "gap": comparison(inputs.sim2real_factor, "smaller", "larger"),
    }


def _lapse(inputs: PaintingInputs, frame_ms: int) -> dict[str, Any]:
    return {
        "lapse": time_lapse(inputs.frames, frame_ms),
        "lapse_alt": f"Time-lapse of the {inputs.setting} painting: {len(inputs.frames)} photographs of the canvas, "
        "from blank to finished.",
        "still": encode_png(inputs.frames[-1]),
    }


def _palette(inputs: PaintingInputs) -> list[tuple[str, int]]:
    """The paints as hexadecimal colours, each with its number of strokes."""
    used = np.stack([stroke.color_srgb for stroke in inputs.executed.strokes])
    nearest = np.square(used[:, None] - inputs.palette_srgb[None]).sum(-1).argmin(1)
    codes = [
        "#" + "".join(f"{round(255 * float(c)):02x}" for c in np.clip(color, 0, 1)) for color in inputs.palette_srgb
    ]
    return [(code, int((nearest == paint).sum())) for paint, code in enumerate(codes)]


def _error_rows(inputs: PaintingInputs) -> list[list[str]]:
    blank = inputs.error["blank"]
    rows = []
    for part, name in _ROWS.items():
        share = inputs.error[part] / blank if blank > 0 else 0.0
        pixel = decimal(inputs.pixel_mse[part]) if part in inputs.pixel_mse else "–"
        rows.append([name, decimal(inputs.error[part]), Markup(percent(share) + bar(share)), pixel])
    return rows


def _deviation_chart(inputs: PaintingInputs) -> bytes:
    series = [
        Series("with replanning", inputs.executed_strokes, inputs.deviation_with, BLUE),
        Series("without replanning", inputs.executed_strokes, inputs.deviation_without, OCHRE, "--"),
    ]
    return line_chart(series, "strokes executed", "MSE from the first plan", (5.6, 3.7))


def _planning_chart(inputs: PaintingInputs) -> bytes | None:
    """None where the plan was not optimised."""
    if not inputs.objective:
        return None
    return line_chart(
        [Series("objective", inputs.iterations, inputs.objective, BLUE)], "iteration", "objective", (11, 3)
    )
