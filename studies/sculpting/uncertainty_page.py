"""The sections of docs/sculpting.md on uncertainty, from what `uncertainty` wrote."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pentimento.report.wording import decimal, percent
from studies.sculpting.uncertainty import ERRORS, summary
from studies.student_t import mean_interval

_MODELS = {
    "one": "one network", "three": "three last layers on one network", "apart": "three networks trained apart"
}  # fmt: skip


def sections(said: dict[str, Any]) -> str:
    """All that was measured of one material."""
    made = {"intervals": _intervals, "sculptures": _sculptures, "actions": _actions, "scans": _scans}
    return "\n".join(write(said) for part, write in made.items() if part in said)


def _intervals(said: dict[str, Any]) -> str:
    lines = []
    for name, found in said["intervals"].items():
        fitted, one = found["as fitted"], found["of one width"]
        lines.append(
            f"| {_MODELS[name]} | {_range(fitted['coverage'])} | "
            f"{_range(fitted['coverage_where_expected'])} | {_range(fitted['coverage_where_it_moved'])} | "
            f"{decimal(fitted['width_mm'])} mm | {decimal(fitted['score_mm'])} mm | {_range(one['coverage'])} | "
            f"{decimal(one['score_mm'])} mm | {percent(found['spread_alone'])} | "
            f"{percent(found['spread_mm2'] / found['residual_mm2'])} |"
        )
    return f"""
## What push models know of their errors

Intervals of the change of height of each pixel that are to contain 90 % of what is seen, in {said["material"]}. Their
variance has four terms: the members' spread, noise of the scans, and shares of the change and of its slope
(`dynamics/pushes/uncertainty.py`); the factors and the width are fitted to pushes that the networks were not trained
on. The table is of pushes of other seeds (another slab, other actions), where the model expects 0.2 mm of change or
more or that much was seen (*coverage*), and of each of the two areas alone. That area was chosen after a look at three
earlier test seeds; the table is of three that were drawn afterwards. *Score* is the mean interval score
(Gneiting & Raftery 2007), lower is better; *one width* are intervals as wide everywhere; the last columns are the
coverage of the spread alone, and its share of the squared residual.

| model | coverage | where expected | where it moved | width | score | one width | score | spread alone | spread |
|---|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def _sculptures(said: dict[str, Any]) -> str:
    runs = said["sculptures"]
    worst = "worst tenth"
    arms = list(dict.fromkeys(run["arm"] for run in runs))
    left = {
        key: {arm: np.array([run[key][1] / run[key][0] for run in runs if run["arm"] == arm]) for arm in arms}
        for key in ERRORS
    }
    lines = []
    for arm in arms:
        cells = []
        for key in ("error_3d_mm2", "visual_error"):
            shares = summary(left[key][arm].tolist())
            cells += [percent(shares["mean"]), percent(shares["worst_tenth"])]
        gain = left["value"][arms[0]] - left["value"][arm]
        actions = float(np.mean([run["actions"] for run in runs if run["arm"] == arm]))
        shares = summary(left["value"][arm].tolist())
        cells += [percent(shares["mean"]), percent(shares["worst_tenth"])]
        cells += ["-" if arm == arms[0] else _interval(gain), decimal(actions)]
        lines.append(f"| {arm} | {' | '.join(cells)} |")
    goals, seeds = (sorted({run[key] for run in runs}) for key in ("goal", "seed"))
    return f"""
## What planning with uncertainty gains

{len(goals)} goals ({", ".join(goals)}) on {len(seeds)} slabs of {said["material"]} in the studio, at most
{said["pushes"]} pushes each. What is left of the error in height, in slope, and of the planner's objective, as a
share of that before, mean of all {len(goals) * len(seeds)} runs and of the worst tenth; the gain is that of the
objective over one network that ignores it, paired by goal and slab, with its 95 % interval (Student's t). *Spread*
plans with the variance of the three members, *unexplained* with the share of each push that the model leaves, both
with a weight of 1: the expected objective.

| plan | height | {worst} | slope | {worst} | objective | {worst} | gain | pushes |
|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def _actions(said: dict[str, Any]) -> str:
    runs = said["actions"]
    plans, levels = list(dict.fromkeys(run["plan"] for run in runs)), sorted({run["level"] for run in runs})
    seeds = len({run["seed"] for run in runs})

    def mean(plan: str, level: float, of: Callable[[dict[str, Any]], float]) -> float:
        return float(np.mean([of(run) for run in runs if (run["plan"], run["level"]) == (plan, level)]))

    def share(run: dict[str, Any], measure: str) -> float:
        return float(run["errors"][measure] / run["nothing"][measure])

    noise = [mean("plain", level, lambda run: run["noise_mm2"]) for level in levels]
    lines = []
    for plan in plans:
        cells = []
        for measure in ("visual_error", "visual_error_at_4_mm", "error_3d_mm2"):
            shares = [mean(plan, level, partial(share, measure=measure)) for level in levels]
            cells += [percent(shares[0]), percent(shares[1]), crossing(noise, shares)]
        lines.append(f"| {plan} | {' | '.join(cells)} |")
    return f"""
## Noise of actions that the plan knows of (thesis 7.5.2)

Plans of {said["pushes"]} pushes in the learned model; slabs, each with a goal: {seeds}; {said["draws"]} draws a level.
They are made by slopes of neighbouring pixels (*plain*), by slopes at a scale, or know the noise: pushes are tried in
the model with and without it, and the share of their energy in height and slope that differs is a cost of each push.
For each error: what is left without noise and with little of it ({decimal(noise[1])} mm²), and the noise from which on
acting is worse than not acting. Noise is that of one action of the plain plan, mm².

| plan | slope | little | worse from | slope at 4 mm | little | worse from | height | little | worse from |
|---|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def _scans(said: dict[str, Any]) -> str:
    runs = said["scans"]
    lines = []
    for noise_m in sorted({run["noise_m"] for run in runs}):
        some = [run for run in runs if run["noise_m"] == noise_m]
        cells = [decimal(1e3 * float(np.mean([run["at a scale"]["scale_m"] for run in some]))) + " mm"]
        for measure in ("visual_error", "error_3d_mm2"):
            left = {
                arm: np.array([run[arm]["errors"][measure] / run["nothing"][measure] for run in some])
                for arm in ("plain", "at a scale")
            }
            cells += [percent(float(left[arm].mean())) for arm in left]
            cells += [_interval(left["plain"] - left["at a scale"])]
        lines.append(f"| {1e3 * noise_m:g} mm | {' | '.join(cells)} |")
    return f"""
## Noise of scans

Plans of {said["pushes"]} pushes in the learned model, each made on scans with white noise of this standard deviation,
a scan after every fourth push. *At a scale* compares slopes of least-squares lines through a Gaussian neighbourhood;
two scans of the slab choose its size, so that noise adds at most 5 % of the error in slope. What is left of the
errors of the surface without noise, in slopes of neighbouring pixels:

| noise | scale | slope, plain | slope, at a scale | gain | height, plain | height, at a scale | gain |
|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def crossing(noise: Sequence[float], shares: Sequence[float]) -> str:
    """From which noise on, mm², an error is above that of doing nothing, by linear interpolation."""
    for number in range(1, len(shares)):
        if shares[number] > 1 >= shares[number - 1]:
            part = (1 - shares[number - 1]) / (shares[number] - shares[number - 1])
            return decimal(noise[number - 1] + part * (noise[number] - noise[number - 1]))
    return f"none up to {decimal(noise[-1])}"


def _range(shares: Sequence[float]) -> str:
    return f"{percent(min(shares))} to {percent(max(shares))}"


def _interval(gains: np.ndarray) -> str:
    found = mean_interval(gains)
    return f"{percent(found.value)} ± {percent(found.high - found.value)}"
