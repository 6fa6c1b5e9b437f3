"""Make docs/sculpting.md of what the experiments wrote: `python -m studies.sculpting.page --results DIR --out docs`.

It takes what there is: `alphabet_<material>_<seed>/`, `reliefs*.json`, `smoothing*.json`, `losses*.json`,
`noise*.json`, `uncertainty*.json`, `places*.json`.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import read_image, write_png
from pentimento.report.figures import BLUE, OCHRE, Series, line_chart
from pentimento.report.wording import decimal, percent
from studies.sculpting.uncertainty_page import crossing, sections
from studies.student_t import mean_interval

_PICTURES = "sculpting"
_RELIEF_PX = 320
"""Side of each picture of a relief."""

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
    for file in sorted(arguments.results.glob("places*.json")):
        said = _read(file)
        shutil.copy(file.with_suffix(".png"), pictures / f"places_{said['material']}.png")
        parts.append(_places(said))
    atomic_write(arguments.out / "sculpting.md", "\n".join(parts).encode())


def _alphabet(folder: Path, pictures: Path) -> str:
    _, material, seed = folder.name.split("_")
    lines = []
    met = right = 0
    records = sorted(folder.glob("*.json"), key=lambda file: int(file.name.partition("_")[0]))
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
        plans = said["plans"]
        lines.append(
            f"| {said['goal']} | {said['seed']} | {len(said['actions'])} | {decimal(said['error_3d_mm2'][0])} | "
            f"{decimal(said['error_3d_mm2'][1])} | {removed['error_3d_mm2']} | {removed['visual_error']} | "
            f"{removed['visual_error_on_grid']} | {plans['wall_s']:.0f} s | {plans['cpu_s']:.0f} s |"
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
height. Replanned after every fourth push; the last columns are the time of all plans of a sculpture together, in one
process with one thread.
*On the plan's pixels* is the error in slope of scans averaged to {grid} × {grid}.

| relief | seed | pushes | height before | after | removed | of slope | on the plan's pixels | planning | processor |
|---|---|---|---|---|---|---|---|---|---|
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
