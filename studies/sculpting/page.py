"""Make docs/sculpting.md of what the experiments wrote: `python -m studies.sculpting.page --results DIR --out docs`.

It takes what there is: `letters_<material>_<seed>/`, `alphabet_<material>_<seed>/`, `reliefs*.json`,
`smoothing*.json`, `losses*.json`, `noise*.json`, `uncertainty*.json`, `places*.json`, `rims_<material>/`,
`planners*.json`.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import read_image, write_png
from pentimento.report.figures import BLUE, OCHRE, Series, line_chart
from pentimento.report.wording import decimal, percent
from studies.sculpting import planners_page, rims
from studies.sculpting.places import ACTIONS, PIXELS
from studies.sculpting.uncertainty_page import crossing, sections
from studies.student_t import mean_interval

_PICTURES = "sculpting"
_RELIEF_PX = 320
"""Side of each picture of a relief."""
_LETTER_PX, _IN_A_ROW = 160, 7
"""Side of each picture of a letter, and letters in a row."""

_OPENING = """# Sculpting: what the planner can do

Written by `python -m studies.sculpting.page --results DIR --out docs`; do not edit. All experiments run
in the virtual studio. Its clay springs back, heaps up, slides and hardens by laws that the models do not contain, and
its scans are noisy. *Height* is the mean squared error of the heights in mm², *slope* that of their spatial gradient;
both are taken over the whole slab of 20 × 20 cm, at 128 × 128 pixels unless a section says otherwise. *Before* is the
error before the first action. Each section names its random seeds; `studies/sculpting/` runs others.
"""


def main(arguments: argparse.Namespace) -> None:
    """Write `sculpting.md` and its pictures into the folder `--out`."""
    pictures = arguments.out / _PICTURES
    pictures.mkdir(parents=True, exist_ok=True)
    parts = [_OPENING]
    letters = sorted(arguments.results.glob("letters_*"))
    if letters:
        parts.append(letters_section(letters, pictures))
    for folder in sorted(arguments.results.glob("alphabet_*")):
        parts.append(_alphabet(folder, pictures))
    reliefs = sorted(arguments.results.glob("reliefs*.json"))
    if reliefs:
        parts.append(_reliefs(reliefs, pictures))
    smoothings = [_read(file) for file in sorted(arguments.results.glob("smoothing*.json"))]
    if smoothings:
        shutil.copy(min(arguments.results.glob("smoothing*.png")), pictures / "smoothing.png")
        parts.append(_smoothing(smoothings))
    runs = [_read(file) for file in sorted(arguments.results.glob("losses*.json"))]
    if runs:
        parts.append(_losses(runs, pictures))
    for file in sorted(arguments.results.glob("noise*.json")):
        parts.append(_noise(_read(file), pictures))
    parts += [sections(_read(file)) for file in sorted(arguments.results.glob("uncertainty*.json"))]
    parts += [planners_page.section(_read(file)) for file in sorted(arguments.results.glob("planners*.json"))]
    for file in sorted(arguments.results.glob("places*.json")):
        said = _read(file)
        shutil.copy(file.with_suffix(".png"), pictures / f"places_{said['material']}.png")
        parts.append(_places(said))
    for folder in sorted(arguments.results.glob("rims_*")):
        parts.append(_rims(folder, pictures))
    atomic_write(arguments.out / "sculpting.md", "\n".join(parts).encode())


def letters_section(folders: list[Path], pictures: Path) -> str:
    """Letters in slabs of their own: one table row and one picture for each material."""
    lines, images, worst = [], [], []
    for folder in folders:
        _, material, seed = folder.name.split("_")
        records = [_read(file) for file in sorted(folder.glob("*.json"), key=_number)]
        removed = {name: [record[name]["removed"] for record in records] for name in ("error_3d_mm2", "visual_error")}
        read, without = (
            sum(record["letter"] == letter for record, letter in zip(records, letters, strict=True))
            for letters in ([record["read"]["clay"] for record in records], [record["before"] for record in records])
        )
        wrong = [f"{r['letter']} as {r['read']['clay']}" for r in records if r["letter"] != r["read"]["clay"]]
        shares = " | ".join(f"{percent(np.mean(each))} | {percent(min(each))}" for each in removed.values())
        pushes = decimal(float(np.mean([len(record["actions"]) for record in records])))
        lines.append(
            f"| {material} | {records[0]['tool']} | {seed} | {pushes} | {shares} | {read} of {len(records)} | "
            f"{without} of {len(records)} |"
        )
        worst += [f"in {material} {', '.join(wrong)}."] if wrong else []
        _write_letters(folder, pictures / f"letters_{material}.jpg")
        images.append(f"In {material}:\n\n![letters]({_PICTURES}/letters_{material}.jpg)\n")
    return f"""
## A to Z, each letter in a smooth slab

The goals are letters of DejaVu Serif, {1e3 * records[0]["reach_m"]:g} mm deep. The classifier was trained on rendered
letters of other font families (STIX, Computer Modern), never on a sculpture. *Removed* is the removed share of the
error: the mean of the letters, and the lowest of them. *Smooth slab* is the baseline: the same classifier on the slab
before the first push.

| material | tool | seed | pushes | height removed | lowest | slope removed | lowest | read correctly | smooth slab |
|---|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}

{" ".join(["Misread:", *worst]) if worst else "No letter is misread."}

{chr(10).join(images)}"""


def _number(file: Path) -> int:
    return int(file.name.partition("_")[0])


def _write_letters(folder: Path, to: Path) -> None:
    """The results of a folder, seven in a row."""
    pairs = [read_image(file) for file in sorted(folder.glob("*.png"), key=_number)]
    results = [
        cv2.resize(pair[:, pair.shape[1] // 2 :], (_LETTER_PX, _LETTER_PX), interpolation=cv2.INTER_AREA)
        for pair in pairs
    ]
    results += [np.full_like(results[0], 255)] * (-len(results) % _IN_A_ROW)
    rows = [np.hstack(results[first : first + _IN_A_ROW]) for first in range(0, len(results), _IN_A_ROW)]
    _, data = cv2.imencode(".jpg", np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])
    atomic_write(to, data.tobytes())


def _alphabet(folder: Path, pictures: Path) -> str:
    _, material, seed = folder.name.split("_")
    lines = []
    met = right = 0
    records = sorted(folder.glob("*.json"), key=_number)
    for file in records:
        said = _read(file)
        height, slope, read = said["error_3d_mm2"], said["visual_error"], said["read"]
        met += height["removed"] >= 0.6
        right += read["clay"] == said["letter"]
        lines.append(
            f"| {said['letter']} | {1e3 * said['reach_m']:g} mm | {len(said['actions'])} | "
            f"{decimal(height['before'])} | {decimal(height['after'])} | "
            f"{percent(height['removed'])} | {percent(slope['removed'])} | "
            f"{read['clay']} ({percent(read['probability'])}) |"
        )
    pairs = [read_image(file.with_suffix(".png")) for file in records]
    halves = [
        cv2.resize(pair, (pair.shape[1] // 2, pair.shape[0] // 2), interpolation=cv2.INTER_AREA) for pair in pairs
    ]
    halves += [np.full_like(halves[0], 255)] * (len(halves) % 2)
    rows = [np.hstack(halves[first : first + 2]) for first in range(0, len(halves), 2)]
    write_png(pictures / f"alphabet_{material}.png", np.vstack(rows))
    return f"""
## The alphabet in {material}, never smoothed in between (thesis Figure 7.1)

Seed {seed}. The letters follow one another in one slab: each goal is fitted to the relief of the letter before, and its
deepest points lie *reach* below the mean height. Pushes only lower the foam, so each letter must be deeper than the one
that it replaces. Pushed foam is rough: for very shallow letters the error in height falls, but that in slope does not.
*Read as* is the output of a letter classifier that was trained on rendered letters only, with its probability. The
error in height falls by
60 % or more for {met} of {len(records)} letters; {right} of {len(records)} are classified correctly.

| letter | reach | pushes | height before | after | height removed | slope removed | read as |
|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}

Goal and result of each:

![alphabet]({_PICTURES}/alphabet_{material}.png)
"""


def _reliefs(files: list[Path], pictures: Path) -> str:
    lines, rows = [], []
    for file in files:
        said = _read(file)
        errors = ("error_3d_mm2", "visual_error", "visual_error_on_grid")
        removed = {name: percent(1 - said[name][1] / said[name][0]) for name in errors}
        noise, plans = said["noise_of_a_scan"]["visual_error"], said["plans"]
        before, after = said["visual_error"]
        lines.append(
            f"| {said['goal']} | {said['seed']} | {len(said['actions'])} | {decimal(said['error_3d_mm2'][0])} | "
            f"{decimal(said['error_3d_mm2'][1])} | {removed['error_3d_mm2']} | {removed['visual_error']} | "
            f"{percent(noise / before)} | {percent(1 - (after - noise) / (before - noise))} | "
            f"{removed['visual_error_on_grid']} | {plans['cpu_s']:.0f} s |"
        )
        three = read_image(file.with_suffix(".png"))
        shape = (3 * _RELIEF_PX, _RELIEF_PX)
        rows.append(cv2.resize(three, shape, interpolation=cv2.INTER_AREA) if three.shape[0] > _RELIEF_PX else three)
    write_png(pictures / "reliefs.png", np.vstack(rows))
    side, grid = said["side_px"], said["grid"][0]
    return f"""
## Reliefs at {side} × {side} pixels (thesis 7.2, A.2)

Scans have {side} × {side} pixels, and errors are those of the scans. The push model, and with it the plan, has
{grid} × {grid}: predicted changes are brought to the scan's pixels by linear interpolation, and the plan lowers the
error there ([performance](performance.md#plans-of-sculptures)). The deepest place lies 9 mm below the foam's mean
height. Replanned after every fourth push; *CPU* is the time of all plans of a sculpture together.
*Scan noise* is the share of the slope error before the first push that is noise of the scan: half the error between
two scans of the same surface. *Without it* is the removed share after this noise is subtracted from both errors.
*Coarse* is the slope error of scans averaged to {grid} × {grid}.

| relief | seed | pushes | height before | after | removed | slope removed | scan noise | without it | coarse | CPU |
|---|---|---|---|---|---|---|---|---|---|---|
{chr(10).join(lines)}

Before, goal and result of each:

![reliefs]({_PICTURES}/reliefs.png)
"""


def _smoothing(runs: list[dict[str, Any]]) -> str:
    lines = []
    for said in runs:
        for name in ("visual", "chamfer"):
            result = said[name]
            shares = [
                percent(result[key][-1] / result[key][0]) for key in ("visual_error", "error_3d_mm2", "chamfer_mm2")
            ]
            lines.append(f"| {said['tool']} | {said['seed']} | {name} | {' | '.join(shares)} |")
    return f"""
## A thin line smoothed in ten pushes (thesis Figure 7.12)

Five pokes with an edge leave a line in dough, 6 mm wide, which ten pushes are to level. Each push is the best of the
same number of candidates, by the error in slope (*visual*) or by the Chamfer distance between point clouds of some 330
points. The table has the remaining errors relative to those before. In a scan of freshly smoothed dough, the error in
slope is, on this scale,
{" and ".join(percent(said["fresh_visual_error"] / said["visual"]["visual_error"][0]) for said in runs)}:

| tool | seed | planned by | slope | height | Chamfer |
|---|---|---|---|---|---|
{chr(10).join(lines)}

The line, and the results of planning by slope and by Chamfer distance:

![smoothing]({_PICTURES}/smoothing.png)
"""


def _losses(runs: list[dict[str, Any]], pictures: Path) -> str:
    lines = []
    series = []
    for said, line in zip(runs, ("-", "--", ":", "-."), strict=False):
        name = f"{said['tool']} in {said['material']}"
        height, slope = said["error_3d_mm2"], said["visual_error"]
        steps = [float(number) for number in range(len(height))]
        series.append(Series(f"height, {name}", steps, [value / height[0] for value in height], BLUE, line))
        series.append(Series(f"slope, {name}", steps, [value / slope[0] for value in slope], OCHRE, line))
        lines.append(
            f"| {name} | {said['seed']} | {percent(height[-1] / height[0])} | {percent(slope[-1] / slope[0])} | "
            f"{percent(min(slope) / slope[0])} | {decimal(said['prediction_error_mm2'])} |"
        )
    chart = line_chart(series, "actions", "error relative to the start", (8, 4))
    atomic_write(pictures / "losses.png", chart)
    return f"""
## Fifty actions: pushed and pinched (thesis Figure 7.11)

The goal is a large X, sunk into the material. The table has the errors after fifty actions and the lowest error in
slope on the way, relative to those before, and the mean squared difference between scanned and predicted heights,
mm² over the whole slab.

| tool | seed | height | slope | lowest slope | prediction error, mm² |
|---|---|---|---|---|---|
{chr(10).join(lines)}

![losses]({_PICTURES}/losses.png)
"""


def _noise(said: dict[str, Any], pictures: Path) -> str:
    nothing, levels = said["nothing"], sorted(said["levels"], key=lambda level: float(level["noise_mm2"]))
    noise = [level["noise_mm2"] for level in levels]
    shares = {name: [level[name] / nothing[name] for level in levels] for name in nothing}
    chart = line_chart(
        [
            Series("height", noise, shares["error_3d_mm2"], BLUE),
            Series("slope", noise, shares["visual_error"], OCHRE),
            Series("no action", [noise[0], noise[-1]], [1.0, 1.0], "#8a8a86", "--"),
        ],
        "noise of one action, mm²", "error relative to no action", (8, 4),
    )  # fmt: skip
    atomic_write(pictures / "noise.png", chart)
    words = [
        f"{crossing(noise, shares[name])} mm² in {word}"
        for word, name in (("slope", "visual_error"), ("height", "error_3d_mm2"))
    ]
    return f"""
## How much noise makes acting worse than not acting (thesis Figure 7.14)

A plan of {said["actions"]} pushes into {said["material"]} is executed in the learned model with Gaussian noise on each
parameter of each action ({said["draws"]} draws per noise level). As in the thesis, noise is measured by its effect: the
mean squared difference between the reliefs after an action with and without noise, in the push model's square around
it. The noise above which acting is worse than not acting:
{" and ".join(words)}.

![noise]({_PICTURES}/noise.png)
"""


def _places(said: dict[str, Any]) -> str:
    lines = []
    for name, found in said["goals"].items():
        runs = found["runs"]
        removed = {arm: [_removed(run[arm], "error_3d_mm2") for run in runs] for arm in _ARMS}
        slopes = {arm: [_removed(run[arm], "visual_error") for run in runs] for arm in _ARMS}
        gain = np.subtract(removed["place and push"], removed["push"]).tolist()
        pellets = np.mean([run["place and push"]["pellets"] for run in runs])
        lines.append(
            f"| {name} | {' | '.join(_interval(removed[arm]) for arm in _ARMS)} | {_interval(gain)} | "
            f"{' | '.join(_interval(slopes[arm]) for arm in _ARMS)} | {decimal(float(pellets))} |"
        )
    seeds = ", ".join(str(run["seed"]) for run in next(iter(said["goals"].values()))["runs"])
    return f"""
## Goals above the surface: placed pellets, in {said["material"]}

Pushes only lower the {said["material"]}. A robot with a feeder also places pellets of it, 6 to 14 mm across, and
presses them flat; the planner chooses pellets or pushes, whichever are expected to lower the objective further. The
pellet model was fitted to {said["pellets"]} pellets: {percent(said["model"]["kept"])} of their volume remains, and
{percent(said["model"]["unexplained"])} of the energy of their footprints is unexplained. At most {said["actions"]}
actions per goal, {1e3 * said["raised_m"]:g} mm above the mean height or {1e3 * said["sunken_m"]:g} mm below it; scans
of {said["pixels"]} × {said["pixels"]} pixels; seeds {seeds}. The table has the removed fraction of the errors, as a
mean over the seeds with its 95 % interval (Student's t); the gain is that in height, paired by seed; *pellets* is the
mean number placed:

| goal | height, pushes alone | height, with pellets | gain | slope, pushes alone | slope, with pellets | pellets |
|---|---|---|---|---|---|---|
{chr(10).join(lines)}

Before, goal, pushes alone, with pellets (first seed, one row per goal):

![places]({_PICTURES}/places_{said["material"]}.png)

Pellets do not help everywhere:

- Below the surface a pellet can only fill a place that a push has made too deep. The sunken letter measures that gain.
- A wall thinner than the smallest pellet, 6 mm, becomes as wide as the pellet, or no pellet is placed.
- A rim steeper than a pellet's flank stays blunt, and pellets side by side leave a bumpy surface. On a smooth goal such
  as the dome, the error in height falls, but that in slope rises above that of the untouched surface.
- Where the surface is too low by less than half the height of the smallest pellet, none is placed: it would overshoot.
- The model adds the same footprint to every surface. On slopes, beside steep walls and on other pellets the pad spreads
  the material differently; each action is followed by a scan, from which the next plan starts.
- The push model is given the shape of a pellet, but not that its material is fresh. Pellets and pushes are not planned
  jointly: a pellet that helps only after a push has flattened it is not found.
"""


_ARMS = ("push", "place and push")


def _rims(folder: Path, pictures: Path) -> str:
    material = folder.name.partition("_")[2]
    shutil.copy(folder / "rims.png", pictures / f"rims_{material}.png")
    runs = [_read(file) for file in sorted(folder.glob("*.json"))]
    seeds = sorted({run["seed"] for run in runs})
    by_run = {(run["goal"], run["arm"], run["seed"]): run for run in runs}
    measures: dict[str, Callable[[dict[str, Any]], float]] = {
        "height": lambda run: _removed(run, "error_3d_mm2"),
        "slope": lambda run: _removed(run, "visual_error"),
        "rise": lambda run: float(run["rise_mm"][1] / run["rise_mm"][0]),
    }
    tables, verdicts = dict[str, str](), list[str]()
    for word, measure in measures.items():
        lines, better = list[str](), {"pinches": list[str](), "pushes": list[str](), "neither": list[str]()}
        for goal in rims.GOALS:
            shares = {arm: [measure(by_run[goal, arm, seed]) for seed in seeds] for arm in rims.ARMS}
            gain = np.subtract(shares["pinch"], shares["push"]).tolist()
            lines.append(f"| {goal} | {' | '.join(_interval(shares[arm]) for arm in rims.ARMS)} | {_interval(gain)} |")
            found = mean_interval(gain)
            better["pinches" if found.low > 0 else "pushes" if found.high < 0 else "neither"].append(goal)
        tables[word] = "\n".join(lines)
        found_for = "; ".join(f"{arm}: {', '.join(goals) or 'none'}" for arm, goals in better.items())
        verdicts.append(f"- {word}: {found_for}")
    pinched = [np.mean([tool == "gripper" for tool in run["tools"]]) for run in runs if run["arm"] == "both"]
    head = "| goal | push (ball) | pinch (gripper) | both | pinch - push |\n|---|---|---|---|---|"
    return f"""
## Pinches compared with pushes on raised and sunken goals, in {material}

The goals are above the surface, and no material is added: raised lines take their volume from beside them. The
lines are {1e3 * rims.RAISED_M:g} mm high and {1e3 * rims.WIDTH_M:g} mm wide between sides
{1e3 * rims.BESIDE_M[1]:g} mm deep, as five pinches side by side left them on a slab that is not in the tables (seed
11). Pushes raise {material}, too: on that slab, two grooves of the ball, 30 mm apart and of two pushes each,
left 2.4 mm between them. Sunken goals are {-1e3 * rims.SUNKEN_M:g} mm deep. Each goal has the volume of the
slab.

At most {ACTIONS} actions a goal; scans of {PIXELS} × {PIXELS} pixels; seeds {", ".join(map(str, seeds))}. In
*both*, each batch of actions uses the tool whose plan predicts the lower error;
{percent(float(np.mean(pinched)))} of its actions are pinches. The tables have means over the seeds with 95 %
intervals (Student's t), not adjusted for the number of goals; the difference is paired by seed. Doing nothing
removes 0 %.

Share of the error in height that was removed:

{head}
{tables["height"]}

Share of the error in slope that was removed:

{head}
{tables["slope"]}

Mean rise of the raised lines (of sunken ones: their fall), as a share of the goal's:

{head}
{tables["rise"]}

Goals for which pinches or pushes are better; *neither* where the interval of the difference contains zero:

{chr(10).join(verdicts)}

Before, goal, pushes, pinches, both (the first seed; one row a goal):

![rims]({_PICTURES}/rims_{material}.png)
"""


def _removed(errors: dict[str, Any], name: str) -> float:
    before, after = errors[name]
    return float(1 - after / before)


def _interval(shares: list[float]) -> str:
    """Mean and half-width of its 95 % interval by Student's t."""
    mean = mean_interval(shares)
    return f"{percent(mean.value)} ± {percent(mean.high - mean.value)}"


def _read(path: Path) -> dict[str, Any]:
    said: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return said


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="page", description=__doc__)
    parser.add_argument("--results", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    main(parser.parse_args())
