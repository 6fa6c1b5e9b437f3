"""The section of docs/sculpting.md that compares planners, from what `planners` wrote."""

from __future__ import annotations

from typing import Any

import numpy as np

from pentimento.report.wording import decimal, percent
from studies.sculpting.planners import ERRORS, ITERATIONS, OURS, PLANNERS, TOOL
from studies.student_t import mean_interval

BAR = 0.8
"""Share of the goals on which the project's planner is to be the best."""
_EQUAL = 0.1
"""Planning times that differ by less than this share count as equal."""
_SAMPLES = PLANNERS["cross-entropy"].samples
_WORDS = {
    OURS: "the project's: all places screened, then Gauss-Newton",
    "screened": "all places screened, more candidates",
    "greedy": "greedy, more candidates",
    "gradient": "greedy, then gradient descent",
    "cross-entropy": "greedy, then the cross-entropy method",
    "particles, heights": "particle model, greedy, error in height alone",
    "particles, our objective": "particle model, greedy, the same objective",
}
_SHORT = {OURS: "the project's", "particles, heights": "particles (height)", "particles, our objective": "particles"}
_MODELS = {"network": "push model", "particles": "particle model", "no change": "no change"}


def section(said: dict[str, Any]) -> str:
    """What was measured in one material."""
    runs = said["runs"]
    names = [name for name in PLANNERS if any(run["planner"] == name for run in runs)]
    goals, seeds = (list(dict.fromkeys(run[key] for run in runs)) for key in ("goal", "seed"))
    left = {(name, key): np.array([_mean(runs, name, goal, key) for goal in goals]) for name in names for key in ERRORS}
    times = {name: float(np.mean([run["cpu_s"] for run in runs if run["planner"] == name])) for name in names}
    lines = []
    for name in names:
        some = [run for run in runs if run["planner"] == name]
        shares = [percent(1 - float(left[name, key].mean())) for key in ERRORS]
        cells = [str(said["candidates"][name]), f"{times[name]:.2f} s", percent(times[name] / times[OURS])]
        cells += [f"{1e3 * sum(run['cpu_s'] for run in some) / sum(run['plans'] for run in some):.0f} ms"]
        cells += [decimal(float(np.mean([run["actions"] for run in some]))), *shares]
        lines.append(f"| {_WORDS[name]} | {' | '.join(cells)} |")
    gains = [
        f"| {_WORDS[name]} | "
        + " | ".join(_gain(left[name, key] - left[OURS, key]) for key in ("error_3d_mm2", "value"))
        + " |"
        for name in names
        if name != OURS
    ]
    predictions = [
        f"| {_MODELS[name]} | {decimal(found['l_3d_mm2'])} mm² | {decimal(found['l_viz'])} |"
        for name, found in said["predictions"].items()
    ]
    each = [
        f"| {goal} | " + " | ".join(_both(left, name, number) for name in names) + " |"
        for number, goal in enumerate(goals)
    ]
    return f"""
## The planner beside others at equal planning time, in {said["material"]}

{len(goals)} goals, {"slab" if len(seeds) == 1 else "slabs"} of seed {", ".join(map(str, seeds))}, the {TOOL},
at most {said["actions"]} pushes a goal, scans of {said["pixels"]} × {said["pixels"]} pixels, a new plan after
every fourth push. *Equal time* means equal processor time of all plans of a sculpture, in one thread. The
project's planner sets this time; the number of candidates of each other planner was chosen to match it on other
goals and another slab (seed {said["fit_seed"]}). The planners ran in turns, so that other load on the machine
slows all of them.

{_times(times)}

- *The project's* planner screens all places: the predicted effect of a push on flat clay is correlated with the
  gradient of the objective. The push model predicts the {said["screened"]} best pushes and some drawn ones again; the
  best of these is improved by Gauss-Newton steps.
- *All places screened* tries more drawn candidates in place of the Gauss-Newton steps. It is a part of the project's
  planner, so the bar does not count it.
- *Greedy* tries more drawn candidates for each push.
- *Gradient descent* and *cross-entropy* start from the greedy sequence and improve it as a whole, in {ITERATIONS}
  iterations. Cross-entropy samples {_SAMPLES} sequences in each, and rolls out one sequence at a time.
- *Particles* plan greedily with a small graph network in the manner of RoboCraft (Shi et al. 2022), made for
  this comparison: each pixel is a particle that receives messages from its neighbours and from particles on the
  path of the tool. It was trained on the same pushes and with the same loss as the push model, for
  {said["epochs"]["particles"]} epochs (the push model: {said["epochs"]["network"]}). One planner with it lowers
  the height error alone, as RoboCraft does; the other lowers the project's objective.
- *Doing nothing* is the baseline, with 0 % in each column.

*Height*, *slope* and *objective* are the removed share of that error, mean over the goals. The objective weighs
height and slope.

| planner | candidates | time a sculpture | of the project's | a plan | pushes | height | slope | objective |
|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}

*Gain* is the remaining share of the error of the other planner minus that of the project's, mean over the goals
with its 95 % interval (Student's t, n = {len(goals)}). A positive gain favours the project's planner. *Better
on* counts the goals where it is better.

| planner | gain in height | better on | gain in objective | better on |
|---|---|---|---|---|
{chr(10).join(gains)}

{_verdict(left, names, len(goals))}

Height and slope removed, by goal:

| goal | {" | ".join(_SHORT.get(name, name) for name in names)} |
|---|{"---|" * len(names)}
{chr(10).join(each)}

Errors of the predicted height (L_3D) and slope (L_viz) on {said["test"]["pushes"]} pushes into another slab (seed
{said["test"]["seed"]}), over the square of the push; they contain the noise of the scans:

| model | L_3D | L_viz |
|---|---|---|
{chr(10).join(predictions)}
"""


def _mean(runs: list[dict[str, Any]], name: str, goal: str, key: str) -> float:
    """Share of an error that a planner leaves of a goal, mean over the slabs."""
    shares = [run[key][1] / run[key][0] for run in runs if (run["planner"], run["goal"]) == (name, goal)]
    return float(np.mean(shares))


def _both(left: dict[tuple[str, str], np.ndarray], name: str, number: int) -> str:
    """Of one goal."""
    return ", ".join(percent(1 - float(left[name, key][number])) for key in ("error_3d_mm2", "visual_error"))


def _times(times: dict[str, float]) -> str:
    """Whether the times are equal."""
    off = [name for name, time in times.items() if abs(time / times[OURS] - 1) > _EQUAL]
    if not off:
        return f"The times differ by at most {percent(max(abs(time / times[OURS] - 1) for time in times.values()))}."
    return f"The time of {' and '.join(_SHORT.get(name, name) for name in off)} is off by more than {percent(_EQUAL)}."


def _verdict(left: dict[tuple[str, str], np.ndarray], names: list[str], count: int) -> str:
    """On how many goals the project's planner is the best of all, and whether that is enough."""
    sentences = []
    for key, word in (("value", "objective"), ("error_3d_mm2", "error in height")):
        rivals = [name for name in names if not PLANNERS[name].screened]
        others = np.min([np.minimum(left[name, key], 1.0) for name in rivals], axis=0)
        best = int((left[OURS, key] < others).sum())
        met = "is met" if best >= BAR * count else "is missed"
        sentences.append(
            f"The project's planner leaves a lower {word} than the rivals and than doing nothing on {best} of {count} "
            f"goals ({percent(best / count)}): the bar of {percent(BAR)} {met}."
        )
    for name in names:
        if name != OURS:
            found = mean_interval(left[name, "value"] - left[OURS, "value"])
            if found.high < 0:
                sentences.append(f"By the objective, *{_WORDS[name]}* is better than the project's planner.")
            elif not found.low > 0:
                sentences.append(f"By the objective, *{_WORDS[name]}* cannot be told from the project's planner.")
    return "\n".join(sentences)


def _gain(gains: np.ndarray) -> str:
    """Cells of a gain of each goal."""
    found = mean_interval(gains.tolist())
    interval = f"{percent(found.value)} ± {percent(found.high - found.value)}"
    return f"{interval} | {int((gains > 0).sum())} of {len(gains)}"
