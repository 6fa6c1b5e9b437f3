"""A comparison as text for the terminal, and as one self-contained HTML page."""

import re
from collections.abc import Mapping
from itertools import zip_longest
from typing import Any

import cv2
import numpy as np

from pentimento.contracts.images import decode_png, encode_png
from pentimento.report.templates import render
from pipelines._review.comparison import Comparison, Pair, Side, StageDifference
from pipelines._review.figures import Figure

_MAX_NAMES = 4
"""Names listed in a sentence."""


def text(comparison: Comparison) -> str:
    """Return the comparison for the terminal."""
    sides = zip("AB", comparison.sides, strict=True)
    lines = [f"{letter}  {side.title}  ({_description(side)})" for letter, side in sides]
    lines += ["", *changes(comparison), ""]
    for stage in comparison.changed:
        lines.append(f"{stage.name}: {_verdict(stage, comparison.sides)}")
        lines += [f"    {name}: {a} -> {b}" for name, (a, b) in [*stage.params.items()][:_MAX_NAMES]]
        if stage.headline is not None and stage.headline.changed:
            a, b = (_with_interval(stage.headline, side) for side in (0, 1))
            lines.append(f"    {stage.headline.name}: A {a}, B {b}")
    same = [stage.name for stage in comparison.stages if stage.same]
    if same:
        lines.append(f"The same in both: {', '.join(same)}.")
    if comparison.origins:
        lines += ["", "On which data:"]
    for path, (one, other) in comparison.origins.items():
        lines.append(f"    {path}: {one}" if one == other else f"    {path}: A {one or 'none'} -> B {other or 'none'}")
    return "\n".join(lines)


def page(comparison: Comparison) -> str:
    """Return the comparison as an HTML page."""
    return render(
        "comparison.html",
        sides=[{"title": side.title, "description": _description(side)} for side in comparison.sides],
        changes=changes(comparison),
        stages=[_stage(stage, comparison.sides) for stage in comparison.changed],
        same=[stage.name for stage in comparison.stages if stage.same],
        origins=list(comparison.origins.items()),
    )


def _stage(stage: StageDifference, sides: tuple[Side, Side]) -> dict[str, Any]:
    """The values of a stage's section of the page."""
    headline = stage.headline
    return {
        "name": stage.name,
        "anchor": re.sub(r"[^a-z0-9]+", "-", stage.name.lower()),
        "verdict": _verdict(stage, sides),
        "class": "" if headline is None else _class(headline),
        "headline": None if headline is None else _figure(headline),
        "runs": [run.id[:8] if run else "none" for run in stage.runs],
        "seconds": [f"{each:.1f} s" if each is not None else "unknown" for each in stage.seconds],
        "params": list(stage.params.items()),
        "inputs": [(path, _short(pair)) for path, pair in stage.inputs.items()],
        "outputs": [(path, _short(pair)) for path, pair in stage.outputs.items()],
        "pictures": beside(*stage.pictures),
        "changed": [_figure(figure) for figure in stage.figures if figure.changed],
        "equal": [_figure(figure) for figure in stage.figures if not figure.changed],
    }


def _figure(figure: Figure) -> dict[str, str]:
    return {
        "name": figure.name,
        "a": _with_interval(figure, 0),
        "b": _with_interval(figure, 1),
        "change": _change(figure),
        "verdict": figure.sentence,
        "class": _class(figure),
    }


def _class(figure: Figure) -> str:
    """The CSS class of a verdict: whether the difference is beyond luck."""
    if not figure.changed or None in figure.values:
        return ""
    return "sure" if figure.beyond_luck else "unsure"


def _change(figure: Figure) -> str:
    a, b = figure.values
    if a is None or b is None or not figure.changed:
        return ""
    relative = f" ({100 * (b - a) / abs(a):+.1f} %)" if a else ""
    return (_number(b - a) + relative).replace("-", "−")


def _short(pair: Pair) -> Pair:
    a, b = (digest and digest[:12] for digest in pair)
    return a, b


def beside(a: Mapping[str, bytes], b: Mapping[str, bytes]) -> list[list[dict[str, Any]]]:
    """Each picture of A, PNGs by name, beside B's of the same name, and their difference."""
    rows = []
    for name in dict.fromkeys([*a, *b]):
        pair = zip_longest("AB", (a.get(name), b.get(name)))
        row = [{"data": data, "caption": f"{letter} {name}"} for letter, data in pair if data is not None]
        if name in a and name in b:
            row.append(_difference(a[name], b[name]))
        rows.append(row)
    return rows


def _difference(a: bytes, b: bytes) -> dict[str, Any]:
    """The absolute difference of two PNGs, inverted and amplified; `data` is None where there is nothing to show."""
    if a == b:
        return {"data": None, "caption": "Equal to the bit."}
    one, other = decode_png(a), decode_png(b)
    if one.shape != other.shape:
        return {"data": None, "caption": "Of different sizes."}
    difference = cv2.absdiff(np.asarray(one), np.asarray(other))
    shown = 255 - np.clip(difference.astype(np.int32) * 2, 0, 255).astype(np.uint8)
    caption = f"difference, amplified twice; maximum {int(difference.max())} of 255"
    return {"data": encode_png(shown), "caption": caption}


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.4g}"


def _with_interval(figure: Figure, side: int) -> str:
    """A value, and its interval where one is recorded."""
    value, interval = figure.values[side], figure.intervals[side]
    return _number(value) + (f" [{interval[0]:.3g}, {interval[1]:.3g}]" if interval else "")


def _description(side: Side) -> str:
    """When it ran, from which code, and how it ended."""
    code = f"commit {side.commit[:8]}" if side.commit else "no commit"
    uncommitted = " with uncommitted changes" if side.dirty else ""
    return f"{side.started}, profile {side.profile}, {code}{uncommitted}, {side.status.lower()}"


def changes(comparison: Comparison) -> list[str]:
    """One sentence each on parameters, data and code."""
    stages = comparison.stages
    params = [f"{stage.name}: {name}" for stage in stages for name in stage.params]
    inputs = list(dict.fromkeys(path for stage in stages for path in stage.inputs))
    outputs = list(dict.fromkeys(path for stage in stages for path in stage.outputs))
    a, b = comparison.sides
    if a.commit != b.commit:
        code = f"The commit differs: {a.commit[:8] or 'none'} and {b.commit[:8] or 'none'}."
    else:
        code = f"The commit is the same ({a.commit[:8] or 'none'})."
    dirty = [name for name, side in zip("AB", (a, b), strict=True) if side.dirty]
    if dirty:
        code += f" {' and '.join(dirty)} ran with uncommitted changes, which the commit does not contain."
    return [
        _listed(params, "parameter"),
        _listed(inputs, "input"),
        _listed(outputs, "output"),
        code,
    ]


def _verdict(stage: StageDifference, sides: tuple[Side, Side]) -> str:
    """The result for the stage's main figure, or the number of figures that differ."""
    for letter, side, run in zip("AB", sides, stage.runs, strict=True):
        if run is None and side.status != "FINISHED":
            return f"not reached in {letter}"
        if run is not None and run.status != "FINISHED":
            return f"did not finish in {letter} ({run.status.lower()})"
    a, b = stage.runs
    if a is None or b is None:
        return f"only in {'A' if b is None else 'B'}"
    if a.id == b.id:
        return "the same run"
    if stage.same:
        return "nothing differs"
    if stage.headline is not None:
        return stage.headline.sentence
    changed = sum(figure.changed for figure in stage.figures)
    return f"{changed} of {len(stage.figures)} figures differ; the stage has no main figure"


def _listed(names: list[str], noun: str) -> str:
    if not names:
        return f"No {noun} differs."
    more = len(names) - _MAX_NAMES
    shown = ", ".join(names[:_MAX_NAMES]) + (f" and {more} more" if more > 0 else "")
    return f"{len(names)} {noun}{'s differ' if len(names) > 1 else ' differs'}: {shown}."
