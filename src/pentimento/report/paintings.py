"""The report's section on one painting: the plan, what came of it, and what replanning changed."""

from __future__ import annotations

from html import escape

import numpy as np

from pentimento.contracts.images import encode_png
from pentimento.report import painting_words as words
from pentimento.report.figures import BLUE, OCHRE, Series, difference_maps, line_chart, stroke_lines
from pentimento.report.html import Album, bar, row, table
from pentimento.report.inputs import PaintingInputs
from pentimento.report.pictures import difference, time_lapse
from pentimento.report.wording import count, decimal, lowered, percent

_ROWS = {
    "blank": "blank canvas",
    "plan": "plan (foretold)",
    "without_replanning": "painting without replanning",
    "with_replanning": "painting with replanning",
}


def hero(inputs: PaintingInputs, frame_ms: int, album: Album) -> str:
    """The page's opening: photograph, painting and time-lapse of one painting."""
    name = inputs.setting
    strokes = count(len(inputs.executed.strokes), "stroke")
    return row(
        [
            album.photo(
                f"{name}_photograph.png", encode_png(inputs.photograph),
                f"The photograph to be painted ({name}).", "The photograph.",
            ),
            album.photo(
                f"{name}_painting_with.png", encode_png(inputs.with_replanning),
                f"The robot’s painting of the photograph ({name}).", f"The painting: {strokes}.",
            ),
            _time_lapse(inputs, frame_ms, album, "How it came about, batch by batch (animation)."),
        ]
    )  # fmt: skip


def painting_section(inputs: PaintingInputs, frame_ms: int, album: Album) -> str:
    """HTML of the section; its pictures go into the album."""
    name = inputs.setting
    svg = album.keep(f"{name}_plan.svg", inputs.plan_svg)
    return f"""<section id="{escape(name)}">
<h2>The {escape(name)} painting</h2>
<p>{words.introduction(inputs)}</p>
{_side_by_side(inputs, album)}
{_palette(inputs)}
<h3>Did looking help?</h3>
<p>Replanning {lowered("the final error against the target", inputs.lowered_by)}.</p>
{_errors(inputs)}
{row([_time_lapse(inputs, frame_ms, album, _LAPSE), _deviation(inputs, album)])}
<h3>From simulation to reality</h3>
{_sim2real(inputs, album)}
<h3>The strokes</h3>
{_lines(inputs, album)}
<p>The first plan as a drawing for a pen plotter, in millimetres: <a href="{svg}">{svg}</a>.</p>
{_planning(inputs, album)}
</section>"""


_LAPSE = "The canvas as the robot’s camera saw it before the first stroke and after every batch, with replanning."


def _side_by_side(inputs: PaintingInputs, album: Album) -> str:
    name = inputs.setting
    pictures = (
        ("photograph", inputs.photograph, "Photograph", "what the user gave, cut to the canvas"),
        ("target", inputs.target, "Target", words.target(inputs)),
        ("plan", inputs.plan, "Plan", "what the stroke model foretells before the first stroke is made"),
        (
            "painting_without", inputs.without, "Painting without replanning",
            "the first plan, executed to its end without looking",
        ),
        (
            "painting_with", inputs.with_replanning, "Painting with replanning",
            "the robot looked after every batch and corrected what it still had to do",
        ),
    )  # fmt: skip
    figures = [
        album.photo(f"{name}_{file}.png", encode_png(image), f"{title} ({name}).", f"<b>{title}</b>: {meaning}.")
        for file, image, title, meaning in pictures
    ]
    return row(figures[:3]) + row(figures[3:])


def _palette(inputs: PaintingInputs) -> str:
    """The paints as swatches, each with the number of strokes made with it."""
    used = np.stack([stroke.color_srgb for stroke in inputs.executed.strokes])
    nearest = np.square(used[:, None] - inputs.palette_srgb[None]).sum(-1).argmin(1)
    swatches = []
    for paint, color in enumerate(inputs.palette_srgb):
        code = "#" + "".join(f"{round(255 * float(channel)):02x}" for channel in np.clip(color, 0, 1))
        strokes = count(int((nearest == paint).sum()), "stroke")
        swatches.append(f'<li><span style="background:{code}"></span><code>{code}</code>{strokes}</li>')
    return (
        f"<h3>The palette</h3><p>{_PALETTE if len(swatches) > 1 else _OWN_INK}</p>"
        f'<ul class="palette">{"".join(swatches)}</ul>'
    )


_PALETTE = (
    "The planner’s colours, gathered into as many paints as a person can mix (k‑means in L*a*b*, thesis "
    "Figure 4.6), with the number of strokes made with each."
)
_OWN_INK = "One colour only: the tool’s own."


def _errors(inputs: PaintingInputs) -> str:
    blank = inputs.error["blank"]
    rows = []
    for part, name in _ROWS.items():
        share = inputs.error[part] / blank if blank > 0 else 0.0
        pixel = decimal(inputs.pixel_mse[part]) if part in inputs.pixel_mse else "–"
        rows.append((name, decimal(inputs.error[part]), f"{percent(share)}{bar(share)}", pixel))
    caption = (
        "Error against the target: the print objective, a mean squared difference in sRGB in [0, 1] averaged over "
        "viewing distances, lower is better. A blank canvas is the baseline. The last column is the plain mean "
        "squared difference per pixel."
    )
    return table(("picture", "error", "of the blank canvas’s", "MSE per pixel"), rows, caption)


def _time_lapse(inputs: PaintingInputs, frame_ms: int, album: Album, caption: str) -> str:
    return album.photo(
        f"{inputs.setting}_timelapse.gif",
        time_lapse(inputs.frames, frame_ms),
        f"Time-lapse of the {inputs.setting} painting: {len(inputs.frames)} photographs of the canvas, from blank "
        "to finished.",
        caption,
        still=encode_png(inputs.frames[-1]),
    )


def _deviation(inputs: PaintingInputs, album: Album) -> str:
    data = line_chart(
        [
            Series("with replanning", inputs.made, inputs.deviation_with, BLUE),
            Series("without replanning", inputs.made, inputs.deviation_without, OCHRE, "--"),
        ],
        "strokes made",
        "MSE from the first plan",
        (5.6, 3.7),
    )
    ended = (inputs.deviation_with[-1], inputs.deviation_without[-1])
    return album.plot(
        f"{inputs.setting}_deviation.png", data,
        f"Two curves of the deviation from the first plan over the strokes made, ending at {decimal(ended[0])} with "
        f"and {decimal(ended[1])} without replanning.",
        words.deviation(inputs),
    )  # fmt: skip


def _sim2real(inputs: PaintingInputs, album: Album) -> str:
    name, mse = inputs.setting, inputs.sim2real_mse
    pair = row(
        [
            album.photo(
                f"{name}_plan.png", encode_png(inputs.plan), f"The plan as Traj2Stroke foretells it ({name}).",
                f"<b>Foretold</b> by the learned model, Traj2Stroke: MSE {decimal(mse['model'])}.",
            ),
            album.photo(
                f"{name}_polyline.png", encode_png(inputs.polyline),
                f"The plan as the constant-width polyline foretells it ({name}).",
                f"<b>Foretold</b> by the trivial model, the polyline: MSE {decimal(mse['polyline'])}.",
            ),
            album.photo(
                f"{name}_painting_without.png", encode_png(inputs.without),
                f"The painting made of the plan without replanning ({name}).",
                "<b>Real</b>: the same plan, executed without replanning.",
            ),
        ]
    )  # fmt: skip
    maps = {
        f"Traj2Stroke: MSE {decimal(mse['model'])}": difference(inputs.plan, inputs.without),
        f"polyline: MSE {decimal(mse['polyline'])}": difference(inputs.polyline, inputs.without),
        f"blank canvas: MSE {decimal(mse['blank'])}": difference(inputs.frames[0], inputs.without),
    }
    heat = album.plot(
        f"{name}_sim2real.png", difference_maps(maps, "difference, sRGB"),
        f"Maps of the difference between foretold and real painting: {', '.join(maps)}.",
        "Where foretold and real painting differ: root mean squared difference over the colour channels, sRGB in "
        "[0, 1], pale where the model was right and dark where it was wrong. The right map is what there is to "
        "foretell: the difference if nothing were painted.",
    )  # fmt: skip
    return f"<p>{words.sim2real(inputs)}</p>{pair}{heat}"


def _lines(inputs: PaintingInputs, album: Album) -> str:
    return album.plot(
        f"{inputs.setting}_strokes.png", stroke_lines(inputs.executed),
        f"The paths of the {len(inputs.executed.strokes)} executed strokes on the canvas, in the colours of their "
        "paints and coloured by their order.",
        "The commanded paths of the executed strokes (with replanning), thicker where the tool was pressed deeper. "
        "Left in the colour of their paint, right by their order, from the first (dark) to the last (bright).",
    )  # fmt: skip


def _planning(inputs: PaintingInputs, album: Album) -> str:
    if not inputs.objective:  # planned without any optimisation
        return ""
    first, last = inputs.objective[0], inputs.objective[-1]
    return album.plot(
        f"{inputs.setting}_planning.png",
        line_chart(
            [Series("objective", inputs.iterations, inputs.objective, BLUE)], "iteration", "objective", (11, 3)
        ),
        f"Curve of the planning objective, from {decimal(first)} to {decimal(last)}.",
        words.planning(inputs),
    )  # fmt: skip
