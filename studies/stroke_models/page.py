"""The page of `studies.stroke_models`: which stroke model to choose, in tables with intervals and exact counts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from studies.stroke_models.candidates import NAMES, TRIVIAL
from studies.stroke_models.compare import Results
from studies.stroke_models.measured import BRUSHES, LIKE, PENS
from studies.stroke_models.statistics import Estimate, estimate, mean_of, ratio

OURS, OURS_CORRECTED = "mechanisms", "corrected"
_CNNS = ("cnn", "coordconv")
_EXTRA = "path_image"
_RATIO, _BELOW_NEXT, _BEST_OF_BRUSHES, _SECONDS = 0.6, 0.75, 6, 60.0

_HEAD = """\
# Which stroke model to choose

Written by `python -m studies.stroke_models`; do not edit. Every model is trained on the same strokes, commanded paths
and windows, with the thesis's weighted L1 (5.3.4). One function computes all scores: the L1 over a stroke's window,
in sRGB between 0 and 1, and the IoU of inked pixels. A pixel is inked if it has more than 110/255 of the contrast
between paper and paint. Both scores are means over strokes at 1 px/mm. Trivial models (blank paper, stamp, polyline)
are fitted once for each score.
To compare the models on your own brush: `python -m studies.stroke_models --strokes TABLE --out DIR`.

| row | model |
|---|---|
| blank paper | predicts no mark |
| stamp | the mean mark of the training strokes, stretched to the stroke's length |
| constant-width polyline | commanded path with one width and one opacity |
| param2stroke | network from length, bend and press to an image (thesis 4.3.2) |
| CNN, CNN with CoordConv | the path through a linear layer and transposed convolutions (5.4.3) |
| U-Net on the path's image | the input is an image of the path; not in the thesis |
| Traj2Stroke | seven parameters and an opacity (5.3.4) |
| Traj2Stroke + U-Net | Traj2Stroke, frozen for half of training; the U-Net's last convolution starts at 0 (5.4.3) |
| Traj2Stroke + mechanisms | extended by the causes that `pentimento diagnose` establishes on the training strokes |
| Traj2Stroke + mechanisms + correction | the row above, frozen, with a small network that shifts and widens the mark |

The rigid tip of a pen follows its command. In the rows with mechanisms a pen therefore has no scale m, unless the
diagnosis establishes one. The networks assume symmetric tools: half of their training strokes are mirrored. The
correction gets the geometry of the stroke only. Its output is multiplied by a factor, chosen on a validation split of
the training strokes, which may be zero.
"""


def whole(
    tables: Mapping[str, Mapping[int, Results]],
    sets: Mapping[str, Sequence[Results]],
    curves: Mapping[str, Mapping[int, Results]],
) -> str:
    """Markdown of all results that exist."""
    sections = [_HEAD]
    for tool, runs in tables.items():
        if runs:
            sections.append(_studio(tool, list(runs.values())))
    if any(tables.values()):
        sections.append(
            "Mean L1 with 95 % intervals (thesis Figure 4.8 and Table 5.2):\n\n![Errors](stroke_models/errors.png)\n"
        )
    sections.append(_curves(curves))
    sections.append(_sets(sets, [name for name in BRUSHES if name in sets], "Photographed strokes: brushes"))
    sections.append(_sets(sets, [name for name in PENS if name in sets], "Photographed strokes: pens"))
    sections += [_brush_bar(sets), _pen_bar(sets), _pictures(sets)]
    return "\n".join(section for section in sections if section)


def own_table(runs: Sequence[Results], name: str, rows: int) -> str:
    """The page of a user's table: each run holds out another quarter of its actions."""
    best = min(runs[0], key=lambda model: estimate(runs, model, "own", "l1").value)
    lines = [
        f"# Stroke models on {name}\n",
        f"{rows} strokes. Cross-validation with {len(runs)} folds, each of which holds out a quarter of the actions. "
        "Means over held-out strokes, with 95 % intervals by bootstrap over strokes.\n",
        *_table(runs, {"held out": "own"}),
        f"\nThe lowest L1 is that of **{NAMES[best]}**. {_said(runs)}\n",
    ]
    return "\n".join(lines)


def _studio(tool: str, runs: Sequence[Results]) -> str:
    strokes = {len(run[name]["scores"]["B"]["l1"]) for run in runs for name in run}
    lines = [
        f"## In the studio: {tool}\n",
        f"Trained on {runs[0][next(iter(runs[0]))]['strokes']} designed Bézier strokes (dataset A). Tested on other "
        f"strokes of A, and on {max(strokes)} strokes of synthetic writers with turns and loops (dataset B). Number of "
        f"studio seeds: {len(runs)}. 95 % intervals: bootstrap over strokes.\n",
        *_table(runs, {"A": "A", "B": "B"}),
        "",
        *_studio_bars(tool, runs),
        "",
        _said(runs) + "\n",
        f"![{tool}](stroke_models/{tool}.png)\n",
    ]
    return "\n".join(lines)


def _table(runs: Sequence[Results], tests: Mapping[str, str]) -> list[str]:
    heads = [f"{score} {label}" for label in tests for score in ("L1", "IoU")]
    lines = [
        "| model | " + " | ".join(heads) + " | training, CPU s | rendering a stroke, ms |",
        "|---|" + "---|" * (len(heads) + 2),
    ]
    for name in _common(runs):
        cells = []
        for test in tests.values():
            cells += [_number(estimate(runs, name, test, "l1"), 4), _number(estimate(runs, name, test, "iou"), 3)]
        seconds = float(np.mean([run[name]["train_s"] - _finding(run[name]) for run in runs]))
        milliseconds = float(np.mean([run[name]["render_ms"] for run in runs]))
        lines.append(f"| {NAMES[name]} | " + " | ".join(cells) + f" | {seconds:.1f} | {milliseconds:.1f} |")
    return lines


def _studio_bars(tool: str, runs: Sequence[Results]) -> list[str]:
    there = _common(runs)
    lines = []
    if tool == "marker" and {"traj2stroke", *_CNNS} <= set(there):
        best = min(_CNNS, key=lambda name: estimate(runs, name, "B", "l1").value)
        found = ratio(runs, "traj2stroke", best, "B", "l1")
        lines.append(
            f"- L1 of Traj2Stroke on B, divided by that of the better CNN ({NAMES[best]}): {_number(found, 2)}, "
            f"target ≤ {_RATIO} {_met(found.value <= _RATIO)}."
        )
    if OURS in there:
        rivals = [name for name in there if name not in (OURS, OURS_CORRECTED, *TRIVIAL)]
        for chosen, whom in (([n for n in rivals if n != _EXTRA], "the thesis's models"), (rivals, "all models")):
            best = min([*chosen, "polyline"], key=lambda name: estimate(runs, name, "B", "l1").value)
            found = ratio(runs, OURS, best, "B", "l1")
            bar = _BELOW_NEXT if tool != "marker" else 1.0
            met = found.value <= bar if bar < 1 else found.value < bar
            lines.append(
                f"- L1 of Traj2Stroke + mechanisms on B, divided by that of the best of {whom} ({NAMES[best]}): "
                f"{_number(found, 2)}, target {'≤ 0.75' if tool != 'marker' else '< 1'} {_met(met)}."
            )
    return lines


def _curves(curves: Mapping[str, Mapping[int, Results]]) -> str:
    lines = []
    for tool, by_size in curves.items():
        if by_size:
            names = [name for name in NAMES if any(name in run for run in by_size.values())]
            lines += [
                f"\nL1 on B, {tool}:\n",
                "| training strokes | " + " | ".join(NAMES[name] for name in names) + " |",
                "|---|" + "---|" * len(names),
            ]
            for size, run in by_size.items():
                cells = [f"{mean_of(run, name, 'B', 'l1'):.4f}" if name in run else "–" for name in names]
                lines.append(f"| {size} | " + " | ".join(cells) + " |")
    if not lines:
        return ""
    return "\n".join(["## Number of training strokes\n", "One seed.", *lines, "\n![Curves](stroke_models/curve.png)\n"])


def _sets(sets: Mapping[str, Sequence[Results]], names: Sequence[str], title: str) -> str:
    if not names:
        return ""
    times = " or ".join(map(str, sorted({len(sets[name]) for name in names})))
    lines = [
        f"## {title}\n",
        "Trained on three quarters of a set. Tested on its held-out strokes, and on another set of a similar tool. "
        f"Values are means over {times} of 4 folds. The best value of each row is bold.\n",
    ]
    for score, best, digits in (("iou", max, 3), ("l1", min, 4)):
        models = [name for name in NAMES if any(name in _common(sets[each]) for each in names) and name != "blank"]
        lines += [
            f"\n{'IoU' if score == 'iou' else 'L1'}:\n",
            "| trained on | tested on | " + " | ".join(NAMES[model] for model in models) + " |",
            "|---|---|" + "---|" * len(models),
        ]
        for name in names:
            for test in ("own", "other"):
                values = {m: estimate(sets[name], m, test, score).value for m in models if m in _common(sets[name])}
                lines.append(_set_row(name, test, values, models=models, best=best, digits=digits))
    found = [f"{name}: {' / '.join(map(_causes, sets[name]))}" for name in names if OURS in _common(sets[name])]
    lines.append(
        "\nCauses established on the training strokes of each fold: " + "; ".join(found) + ".\n" if found else ""
    )
    return "\n".join(lines)


def _set_row(
    name: str, test: str, values: Mapping[str, float], *, models: Sequence[str], best: Callable[..., str], digits: int
) -> str:
    first = best(values, key=lambda model: values[model])
    cells = [
        "–" if m not in values else f"**{values[m]:.{digits}f}**" if m == first else f"{values[m]:.{digits}f}"
        for m in models
    ]
    where = "held out" if test == "own" else LIKE[name]
    return f"| {name} | {where} | " + " | ".join(cells) + " |"


def _brush_bar(sets: Mapping[str, Sequence[Results]]) -> str:
    there = [name for name in BRUSHES if name in sets and OURS in _common(sets[name])]
    if not there:
        return ""
    lines = []
    for ours, other in ((OURS, OURS_CORRECTED), (OURS_CORRECTED, OURS)):
        done = [name for name in there if ours in _common(sets[name])]
        for test, where in (("own", "held-out strokes"), ("other", "another set")) if done else ():
            for left_out, whom in (((_EXTRA,), "the thesis's models and the trivial ones"), ((), "all other rows")):
                won = [name for name in done if _best(sets[name], test, (other, *left_out)) == ours]
                lines.append(
                    f"- On {where}, {NAMES[ours]} has a better IoU than {whom} on {len(won)} of {len(done)} brush "
                    f"sets, target {_BEST_OF_BRUSHES} of {len(BRUSHES)} {_met(len(won) >= _BEST_OF_BRUSHES)}."
                )
    return "\n".join(lines) + "\n"


def _pen_bar(sets: Mapping[str, Sequence[Results]]) -> str:
    there = [name for name in PENS if name in sets and {OURS, "polyline"} <= set(_common(sets[name]))]
    if not there:
        return ""
    lines = []
    for test, where in (("own", "held-out strokes"), ("other", "another set")):
        iou = {name: [estimate(sets[name], m, test, "iou").value for m in (OURS, "polyline")] for name in there}
        beaten = [name for name, (ours, polyline) in iou.items() if ours < polyline]
        lines.append(
            f"- On {where} of pens, the polyline has a better IoU than {NAMES[OURS]} on {len(beaten)} of "
            f"{len(there)} sets, target 0 {_met(not beaten)}."
        )
    return "\n".join(lines) + "\n"


def _pictures(sets: Mapping[str, Sequence[Results]]) -> str:
    lines = [f"Held-out strokes of `{name}`:\n\n![{name}](stroke_models/{name}.png)\n" for name in sets]
    return "\n".join(lines)


def _best(runs: Sequence[Results], test: str, left_out: Sequence[str]) -> str:
    there = [name for name in _common(runs) if name not in left_out]
    return max(there, key=lambda name: estimate(runs, name, test, "iou").value)


def _said(runs: Sequence[Results]) -> str:
    found = [_causes(run) for run in runs if OURS in run]
    if not found:
        return ""
    slowest = max((run[n]["train_s"] - _finding(run[n]), n) for run in runs for n in run)
    finding = np.mean([_finding(run[OURS]) for run in runs if OURS in run])
    return (
        f"Causes established on the training strokes of each run: {'; '.join(found)}. The diagnosis took {finding:.0f} "
        f"CPU seconds, which the table does not include. The slowest training, {NAMES[slowest[1]]}, took "
        f"{slowest[0]:.0f} s, target ≤ {_SECONDS:.0f} {_met(slowest[0] <= _SECONDS)}."
    )


def _causes(run: Results) -> str:
    said = run[OURS]["said"]
    names = ", ".join(f"`{cause}`" for cause in said["established"]) or "nothing"
    return names + (
        "" if said["kept"] or not said["established"] else " (not used: the joint fit with it is no better)"
    )


def _finding(result: Mapping[str, object]) -> float:
    said = result["said"]
    assert isinstance(said, dict)
    return float(said.get("diagnosing_s", 0.0))


def _common(runs: Sequence[Results]) -> list[str]:
    return [name for name in NAMES if all(name in run for run in runs)]


def _number(found: Estimate, digits: int) -> str:
    return f"{found.value:.{digits}f} ({found.low:.{digits}f} to {found.high:.{digits}f})"


def _met(met: bool) -> str:
    return "(met)" if met else "(not met)"
