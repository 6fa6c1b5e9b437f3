"""Pictures of the comparison: strokes beside what each model predicts, mean errors, learning curves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np

from studies.stroke_models.candidates import NAMES, NETWORKS, TRIVIAL
from studies.stroke_models.compare import Results
from studies.stroke_models.statistics import estimate, mean_of

_COLOURS = {
    "polyline": "#8c8c8c", "param2stroke": "#c49a00", "cnn": "#d1495b", "coordconv": "#edae49", "path_image": "#8d6a9f",
    "traj2stroke": "#30638e", "refined": "#00798c", "mechanisms": "#1b998b",
    "corrected": "#0b6e4f", "stamp": "#bbbbbb", "blank": "#dddddd",
}  # fmt: skip


def strokes(folder: Path, test: str, out: Path) -> None:
    """A row for each stroke of a test set that was kept: command, photograph, and what each model predicted."""
    measured = np.load(folder / "measured.npz")
    found = {name: np.load(folder / f"{name}.npz")[test] for name in NAMES if (folder / f"{name}.npz").exists()}
    found.pop("blank", None)
    after, path, valid = (measured[f"{test}_{what}"] for what in ("after", "path", "valid"))
    figure, axes = plt.subplots(
        len(after), 1 + len(found), figsize=(1.5 * (1 + len(found)), 1.15 * len(after)), squeeze=False
    )
    for row, shown in enumerate(valid):
        height, width = shown.any(1).sum(), shown.any(0).sum()
        images = {"photograph, command": after[row], **{NAMES[name]: image[row] for name, image in found.items()}}
        for axis, (title, image) in zip(axes[row], images.items(), strict=True):
            axis.imshow(image[:height, :width])
            axis.set(xticks=[], yticks=[])
            if row == 0:
                axis.set_title(fill(title, 20), fontsize=7)
        axes[row, 0].plot(*path[row].T, color="#d1495b", linewidth=0.7)
    _save(figure, out)


def errors(tables: Mapping[str, Mapping[int, Results]], out: Path) -> None:
    """Mean L1 on A (Figure 4.8) and on B (Table 5.2) of each model."""
    figure, axes = plt.subplots(len(tables), 2, figsize=(8, 2.6 * len(tables)), squeeze=False)
    for line, (tool, runs) in zip(axes, tables.items(), strict=True):
        for axis, test in zip(line, ("A", "B"), strict=True):
            common = [name for name in NAMES if name != "blank" and runs and all(name in run for run in runs.values())]
            for place, name in enumerate(reversed(common)):
                found = estimate(list(runs.values()), name, test, "l1")
                errors = [[found.value - found.low], [found.high - found.value]]
                axis.barh(place, found.value, color=_COLOURS[name], xerr=errors, ecolor="#444444")
            axis.set_yticks(range(len(common)), [NAMES[name] for name in reversed(common)], fontsize=7)
            axis.set_title(f"{tool}, dataset {test}: mean L1, sRGB", fontsize=8)
            axis.tick_params(axis="x", labelsize=7)
    _save(figure, out)


def curves(found: Mapping[str, Mapping[int, Results]], out: Path) -> None:
    """L1 on B by the number of training strokes."""
    figure, axes = plt.subplots(1, len(found), figsize=(4.2 * len(found), 3.2), squeeze=False)
    for axis, (tool, by_size) in zip(axes[0], found.items(), strict=True):
        for name in [n for n in NAMES if n not in TRIVIAL or n == "polyline"]:
            sizes = [size for size, run in by_size.items() if name in run]
            if sizes:
                values = [mean_of(by_size[size], name, "B", "l1") for size in sizes]
                style = "--" if name in (*NETWORKS, "path_image") else "-"
                axis.plot(sizes, values, style, color=_COLOURS[name], marker=".", label=NAMES[name])
        axis.set(xscale="log", yscale="log", xlabel="training strokes", ylabel="mean L1 on B, sRGB", title=tool)
        axis.legend(fontsize=6)
    _save(figure, out)


def _save(figure: plt.Figure, out: Path) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.tight_layout(pad=0.4)
    figure.savefig(out, dpi=110, metadata={"Software": None})
    plt.close(figure)
