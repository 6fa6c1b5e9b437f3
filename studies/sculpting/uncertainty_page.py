"""The sections of docs/sculpting.md on uncertainty, from the results of `uncertainty`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pentimento.report.wording import decimal, percent
from studies.sculpting.uncertainty import ERRORS, summary
from studies.student_t import mean_interval

_MODELS = {
    "one": "one network", "three": "one network, three last layers", "apart": "ensemble of three networks"
}  # fmt: skip
_INTERVALS = (
    "model", "coverage", "predicted ≥ 0.2 mm", "measured ≥ 0.2 mm", "mean width", "score", "coverage, constant width",
    "score, constant width", "coverage, ensemble only", "ensemble variance / squared residual",
)  # fmt: skip
_ACTIONS = (
    "plan", "slope: no noise", "little noise", "limit, mm²", "slope at 4 mm: no noise", "little noise", "limit, mm²",
    "height: no noise", "little noise", "limit, mm²",
)  # fmt: skip
"""Heads of the tables of `_intervals` and of `_actions`."""


def sections(results: dict[str, Any]) -> str:
    """The sections of one material's results, a dictionary by part."""
    writers = {"intervals": _intervals, "sculptures": _sculptures, "actions": _actions, "scans": _scans}
    return "\n".join(write(results) for part, write in writers.items() if part in results)


def _intervals(results: dict[str, Any]) -> str:
    lines = []
    for name, found in results["intervals"].items():
        fitted, one = found["as fitted"], found["of one width"]
        lines.append(
            f"| {_MODELS[name]} | {_range(fitted['coverage'])} | "
            f"{_range(fitted['coverage_where_expected'])} | {_range(fitted['coverage_where_it_moved'])} | "
            f"{decimal(fitted['width_mm'])} mm | {decimal(fitted['score_mm'])} mm | {_range(one['coverage'])} | "
            f"{decimal(one['score_mm'])} mm | {percent(found['spread_alone'])} | "
            f"{percent(found['spread_mm2'] / found['residual_mm2'])} |"
        )
    return f"""
## Calibration of the push models' uncertainty

For each pixel the model predicts a 90 % interval of the change of height, in {results["material"]}. Its variance is
the sum of the ensemble's variance, the noise of the scans, and terms proportional to the squared change and to its
squared gradient (`dynamics/pushes/uncertainty.py`). Their factors and the width of the interval are fitted to a
validation split. The baseline *constant width* has the same interval everywhere, fitted likewise.

The test pushes have other seeds (another slab, other actions). *Coverage* is the fraction of measured changes inside
the interval, from the lowest to the highest test seed, over pixels where a change of 0.2 mm or more is predicted or
measured; the next two columns take either condition alone. These pixels were chosen after a look at three earlier test
seeds; the three seeds of the table were drawn afterwards. *Score* is the mean interval score (Gneiting & Raftery 2007),
lower is better. The last two columns are of the ensemble's variance alone: the coverage of its intervals, and its ratio
to the mean squared residual.

| {" | ".join(_INTERVALS)} |
|---|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def _sculptures(results: dict[str, Any]) -> str:
    runs = results["sculptures"]
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
## Gain by planning with uncertainty

{len(goals)} goals ({", ".join(goals)}) on {len(seeds)} slabs of {results["material"]} in the studio, at most
{results["pushes"]} pushes each. The table has the remaining errors in height and in slope and the remaining objective
of the planner, relative to those before: means of all {len(goals) * len(seeds)} runs and of the worst tenth. *Gain* is
the decrease of that mean objective relative to the first plan, one network without uncertainty, paired by goal and
slab, with its 95 % interval (Student's t). *Spread* adds the variance of the three members to the objective,
*unexplained* the fraction of each push's effect that the model does not explain. Both have a weight of 1, which gives
the expected objective.

| plan | height | {worst} | slope | {worst} | objective | {worst} | gain | pushes |
|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def _actions(results: dict[str, Any]) -> str:
    runs = results["actions"]
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
## Plans that account for execution noise (thesis 7.5.2)

Plans of {results["pushes"]} pushes, executed in the learned model; {seeds} slabs with one goal each;
{results["draws"]} draws per noise level. *Plain* plans compare slopes of neighbouring pixels, the next ones slopes at
a scale of 4 mm. Plans with *noise known* add a cost to each push. For it, the pushes of the plain plan are simulated
with and without noise; the cost is the fraction of their energy, in height and in slope, in which the two results
differ. For each error, the table has the fraction that remains without noise and with little noise
({decimal(noise[1])} mm²), and the limit, the noise in mm² above which acting is worse than not acting. Noise is that
of one action of the plain plan.

| {" | ".join(_ACTIONS)} |
|---|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def _scans(results: dict[str, Any]) -> str:
    runs = results["scans"]
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

Plans of {results["pushes"]} pushes in the learned model, each from scans with white noise of the standard deviation in
the first column, with a new scan after every fourth push. *At a scale* takes slopes by least squares in a Gaussian
neighbourhood; its size is chosen from two scans of the slab, so that noise adds at most 5 % of the error in slope. The
table has the remaining errors of the surface without noise, with slopes of neighbouring pixels, relative to those
before:

| noise | scale | slope, plain | slope, at a scale | gain | height, plain | height, at a scale | gain |
|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}
"""


def crossing(noise: Sequence[float], shares: Sequence[float]) -> str:
    """The noise in mm² above which an error exceeds that without any action, by linear interpolation."""
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
