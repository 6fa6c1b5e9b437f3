"""The comparison as one HTML page that needs nothing else."""

import re
from html import escape
from importlib import resources
from itertools import zip_longest

import cv2
import numpy as np

from pentimento.contracts.images import decode_png, encode_png
from pentimento.report.html import Album, row, table
from pipelines._review.comparison import Comparison, Pair, StageDifference
from pipelines._review.judgement import Figure
from pipelines._review.wording import number, of_side, verdict, what_changed, with_interval

_STYLE = """
h1 { font-size: 2.2rem; } h2 { font-size: 1.5rem; margin-top: 3rem; overflow-wrap: anywhere; }
h3 { font-size: 1.1rem; margin-top: 1.75rem; }
.sides { display: grid; gap: 0 2rem; grid-template-columns: repeat(auto-fit, minmax(min(20rem, 100%), 1fr)); }
.sides p { margin: .25rem 0; } .sides b { font-size: 1.05rem; }
.sure { color: #1a7f4b; font-weight: 600; } .unsure { color: #a05a00; } .quiet { color: var(--quiet); }
@media (prefers-color-scheme: dark) { .sure { color: #6fce9b; } .unsure { color: #e0a85c; } }
tbody th, td { overflow-wrap: anywhere; } tbody th { min-width: 11rem; } .value { white-space: nowrap; }
details { margin: 1rem 0; } summary { cursor: pointer; color: var(--accent); }
.photo img { image-rendering: auto; border: 1px solid var(--line); }
"""
_LUCK = (
    "A difference is called <b>beyond luck</b> where other held-out items would not undo it: the 95&nbsp;% bootstrap "
    "interval of the paired difference leaves out zero or, without common items, the recorded intervals do not "
    "overlap. What another seed of the training would change is not in it: repeat the run with one."
)


def page(comparison: Comparison) -> str:
    """Return the page."""
    a, b = comparison.sides
    style = resources.files("pentimento.report").joinpath("templates/style.css").read_text(encoding="utf-8")
    same = [stage.name for stage in comparison.stages if stage.same]
    body = "".join(
        [
            f"<header><h1>Two runs compared</h1>{_sides(comparison)}</header><main>",
            "<section id='changed'><h2>What changed</h2><ul>",
            *(f"<li>{escape(sentence)}</li>" for sentence in what_changed(comparison)),
            "</ul></section><section id='better'><h2>Which is better, and is it luck?</h2>",
            _overview(comparison),
            f"<p class='quiet'>The same in both: {escape(', '.join(same))}.</p>" if same else "",
            f"<p class='quiet'>{_LUCK}</p></section>",
            _origins(comparison),
            *(_stage(stage) for stage in comparison.changed),
            "</main>",
        ]
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(a.title)} and {escape(b.title)}</title>\n<style>\n{style}{_STYLE}</style></head>\n"
        f"<body>{body}</body></html>\n"
    )


def _sides(comparison: Comparison) -> str:
    made = [
        f"<p><b>{letter}</b> &ensp;<b>{escape(side.title)}</b><br>"
        f"<span class='quiet'>{escape(of_side(side))}</span></p>"
        for letter, side in zip("AB", comparison.sides, strict=True)
    ]
    return f"<div class='sides'>{''.join(made)}</div>"


def _overview(comparison: Comparison) -> str:
    rows = []
    for stage in comparison.changed:
        figure = stage.headline
        values = ["", ""] if figure is None else [_value(figure, side) for side in (0, 1)]
        name = f'<a href="#{_anchor(stage)}">{escape(stage.name)}</a>'
        rows.append([name, f"<code>{escape(figure.name)}</code>" if figure else "", *values, _coloured(stage)])
    if not rows:
        return "<p>Nothing differs.</p>"
    return table(["stage", "main figure", "A", "B", "verdict"], rows, "Stages that differ", numbers_from=9)


def _origins(comparison: Comparison) -> str:
    said = _pairs(comparison.origins, "What was read, and what it says of itself", "path")
    return f"<section id='data'><h2>On which data?</h2>{said}</section>" if said else ""


def _coloured(stage: StageDifference) -> str:
    return _luck(verdict(stage), stage.headline)


def _luck(sentence: str, figure: Figure | None) -> str:
    if figure is None or not figure.changed or None in figure.values:
        return escape(sentence)
    return f'<span class="{"sure" if figure.beyond_luck else "unsure"}">{escape(sentence)}</span>'


def _stage(stage: StageDifference) -> str:
    seconds = " and ".join(f"{each:.1f} s" if each is not None else "unknown" for each in stage.seconds)
    ids = " and ".join(f"<code>{run.id[:8]}</code>" if run else "none" for run in stage.runs)
    return "".join(
        [
            f'<section id="{_anchor(stage)}"><h2>{escape(stage.name)}</h2>',
            f"<p>{_coloured(stage)}. <span class='quiet'>Runs {ids}; they took {seconds}.</span></p>",
            _pairs(stage.params, "Parameters that differ", "parameter"),
            _pairs({path: _short(pair) for path, pair in stage.data.items()}, "Data that differs, by MD5", "path"),
            _pictures(stage),
            _figures(stage),
            "</section>",
        ]
    )


def _pairs(pairs: dict[str, Pair], caption: str, head: str) -> str:
    rows = [[f"<code>{escape(name)}</code>", *(escape(str(v)) if v is not None else "–" for v in pair)]
            for name, pair in pairs.items()]  # fmt: skip
    return table([head, "A", "B"], rows, caption, numbers_from=9) if rows else ""


def _short(pair: Pair) -> Pair:
    a, b = (digest and digest[:12] for digest in pair)
    return a, b


def _figures(stage: StageDifference) -> str:
    """Those that changed; the others are folded away."""
    changed = [figure for figure in stage.figures if figure.changed]
    equal = [figure for figure in stage.figures if not figure.changed]
    made = _figure_table(changed, "Figures that differ") if changed else ""
    if equal:
        folded = _figure_table(equal, "Equal in both")
        made += f"<details><summary>{len(equal)} figures are equal</summary>{folded}</details>"
    return made


def _figure_table(figures: list[Figure], caption: str) -> str:
    rows = [
        [f"<code>{escape(each.name)}</code>", _value(each, 0), _value(each, 1), _change(each),
         _luck(each.sentence, each)]
        for each in figures
    ]  # fmt: skip
    return table(["figure", "A", "B", "B − A", "verdict"], rows, caption, numbers_from=9)


def _change(figure: Figure) -> str:
    a, b = figure.values
    if a is None or b is None or not figure.changed:
        return ""
    share = f" ({100 * (b - a) / abs(a):+.1f} %)" if a else ""
    return f'<span class="value">{(number(b - a) + share).replace("-", "−")}</span>'


def _value(figure: Figure, side: int) -> str:
    return f'<span class="value">{with_interval(figure, side)}</span>'


def _pictures(stage: StageDifference) -> str:
    """Each picture of A beside B's of the same name, and where they differ."""
    a, b = stage.pictures
    made = []
    for name in dict.fromkeys([*a, *b]):
        album, figures = Album(), []
        for letter, data in zip_longest("AB", (a.get(name), b.get(name))):
            if data is not None:
                figures.append(
                    album.photo(f"{letter}_{name}", data, f"{name} of {letter}", f"<b>{letter}</b> {escape(name)}")
                )
        made.append(row(figures + _difference(name, a.get(name), b.get(name))))
    return "<h3>Pictures</h3>" + "".join(made) if made else ""


def _difference(name: str, a: bytes | None, b: bytes | None) -> list[str]:
    if a is None or b is None:
        return []
    if a == b:
        return ['<figure class="photo"><figcaption>Equal to the bit.</figcaption></figure>']
    one, other = decode_png(a), decode_png(b)
    if one.shape != other.shape:
        return ['<figure class="photo"><figcaption>Of different sizes.</figcaption></figure>']
    apart = cv2.absdiff(np.asarray(one), np.asarray(other))
    shown = 255 - np.clip(apart.astype(np.int32) * 2, 0, 255).astype(np.uint8)
    caption = f"where they differ, twice as strong; at most {int(apart.max())} of 255"
    return [Album().photo(f"difference_{name}", encode_png(shown), f"difference of {name}", caption)]


def _anchor(stage: StageDifference) -> str:
    return re.sub(r"[^a-z0-9]+", "-", stage.name.lower())
