"""RoboCook's real dough as an out-of-domain check: `python -m studies.sculpting.robocook --out docs`.

The file `robocook_dough_states.npz` in the folder that PENTIMENTO_MEASURED names holds ten states of one piece of dough
as point clouds, and nine transitions between them, each by another tool. No action is recorded. So nothing can be
predicted: each transition is compared with no change, with the mean change of the other eight, and with the best push
of the studio's analytic model, fitted to the transition by a search. The search has six free parameters; as a control,
it is run on the reversed transition, which no tool made.

Clouds become height maps in the project's frame: x and y of the robot's base, z above the lowest point of the two
clouds, cells of 4 mm, the highest point in each. The clouds are of dough alone: a cell without a point is table.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.images import write_png
from pentimento.goals3d.shading import photograph
from pentimento.planning.pushes.analytic.model import AnalyticPush, first_model
from pentimento.planning.pushes.analytic.scene import local_places, push_scene
from pentimento.report.wording import decimal, percent
from studies.student_t import mean_interval

FloatArray = NDArray[np.float64]

FILE: Final = "robocook_dough_states.npz"
VARIABLE: Final = "PENTIMENTO_MEASURED"
SEQUENCE: Final = "dumpling__"
CELL_M: Final = 0.004
"""Coarser than the clouds' spacing on the surface, 1 to 3 mm, so that most cells with dough hold a point."""
CELLS: Final = 48
WINDOW_M: Final = (0.0, 0.0, CELLS * CELL_M, CELLS * CELL_M)
CUT_OR_CARRIED: Final = ("cutter_planar", "pusher", "spatula_small", "spatula_large", "hook")
"""Tools that remove or carry dough, which no push does."""
ROUNDS, TRIES, BEST = 10, 128, 16
"""Of the search: rounds, pushes per round (eight times as many in the first), and the best that seed the next round."""
LOW: Final = np.array([-np.pi, 0.0, 0.001, np.log(0.004)])
HIGH: Final = np.array([np.pi, 0.06, 0.045, np.log(0.03)])
"""Range of the search: direction, length, depth, and the logarithm of the footprint's half-width."""
BESIDE_M: Final = 0.01
"""A push starts on the dough before, or this near to its box."""


@dataclass(frozen=True)
class Transition:
    """Two states of the dough, one after the other."""

    tool: str
    before_m: FloatArray
    """[H, W] above the lowest point of both clouds; 0 where there is no dough."""
    after_m: FloatArray
    carried: bool
    """The dough lay at another place after; ``after_m`` is moved back by the distance of the two middles."""
    sampling_mm2: float
    """Mean squared difference of the heights of two random halves of the cloud after, where both have dough."""

    @property
    def dough(self) -> NDArray[np.bool_]:
        """[H, W]: cells with dough before or after."""
        return (self.before_m > 0) | (self.after_m > 0)

    def error_mm2(self, predicted_m: FloatArray) -> FloatArray:
        """Squared error of heights after [..., H, W], summed over the window, for each cell with dough before or after.

        Dough that is predicted on the bare table counts, too.
        """
        return np.asarray(1e6 * ((predicted_m - self.after_m) ** 2).sum(axis=(-2, -1)) / self.dough.sum())

    @property
    def reverse(self) -> Transition:
        """From after to before."""
        return Transition(self.tool, self.after_m, self.before_m, self.carried, self.sampling_mm2)


@dataclass(frozen=True)
class Found:
    """The best push that the search found, and what it leaves."""

    action: FloatArray
    """[5] of the contract."""
    half_width_m: float
    predicted_m: FloatArray
    """[H, W] heights after it."""


def main(arguments: argparse.Namespace) -> None:
    """Write `robocook_dough.md` and its picture into the folder `--out`; without the data, say so."""
    folder = os.environ.get(VARIABLE)
    if not folder or not (Path(folder) / FILE).is_file():
        print(f"{VARIABLE} names no folder with {FILE}; the check on real dough is left out.")
        return
    pairs = transitions(Path(folder) / FILE)
    others = [mean_of_others(pairs, number) for number in range(len(pairs))]
    found = [best_push(pair, seed=number) for number, pair in enumerate(pairs)]
    backwards = [best_push(pair.reverse, seed=number) for number, pair in enumerate(pairs)]
    write_png(arguments.out / "sculpting" / "robocook.png", picture(pairs, found))
    atomic_write(arguments.out / "robocook_dough.md", page(pairs, others, found, backwards).encode())


def transitions(path: Path) -> list[Transition]:
    """The nine transitions in the file, in their order."""
    with np.load(path, allow_pickle=False) as stored:
        names = sorted(name for name in stored.files if name.startswith(SEQUENCE))
        clouds = [stored[name].astype(np.float64) for name in names]
    tools = [name.removeprefix(SEQUENCE).partition("_")[2] for name in names]
    return [transition(*clouds[k : k + 2], tools[k + 1], seed=k) for k in range(len(clouds) - 1)]


def transition(before: FloatArray, after: FloatArray, tool: str, *, seed: int) -> Transition:
    """Two clouds [N, 3] in metres, as height maps in one window around the dough before.

    A dough that was carried, so that the two boxes do not overlap, is moved back by the distance of their middles.
    """
    middles = [0.5 * (cloud.min(0) + cloud.max(0)) for cloud in (before, after)]
    carried = bool((np.abs(middles[1] - middles[0])[:2] > 0.5 * (np.ptp(before, 0) + np.ptp(after, 0))[:2]).any())
    if carried:
        moved = middles[1] - middles[0]
        after = after - np.array([moved[0], moved[1], after[:, 2].min() - before[:, 2].min()])
    lowest = min(before[:, 2].min(), after[:, 2].min())
    middle = 0.5 * (np.minimum(before.min(0), after.min(0)) + np.maximum(before.max(0), after.max(0)))
    corner = np.array([middle[0] - WINDOW_M[2] / 2, middle[1] - WINDOW_M[3] / 2, lowest - 0.001])
    halves = np.array_split(np.random.default_rng(seed).permutation(len(after)), 2)
    first, second = (heights(after[half] - corner) for half in halves)
    both = (first > 0) & (second > 0)
    sampling = float(1e6 * ((first - second)[both] ** 2).mean())
    return Transition(tool, heights(before - corner), heights(after - corner), carried, sampling)


def heights(cloud: FloatArray) -> FloatArray:
    """[H, W]: the highest point of a cloud [N, 3] of the canvas frame in each cell of the window; 0 without a point."""
    columns, rows = (
        np.floor(cloud[:, 0] / CELL_M).astype(int),
        np.floor((WINDOW_M[3] - cloud[:, 1]) / CELL_M).astype(int),
    )
    found = np.zeros((CELLS, CELLS))
    np.maximum.at(found, (rows, columns), cloud[:, 2])
    return found


def mean_of_others(pairs: list[Transition], number: int) -> FloatArray:
    """Heights [H, W] predicted by the mean change of all other transitions, each about the middle of its window."""
    changes = [pair.after_m - pair.before_m for k, pair in enumerate(pairs) if k != number]
    return np.maximum(pairs[number].before_m + np.mean(changes, axis=0), 0.0)


def best_push(pair: Transition, *, seed: int) -> Found:
    """The push of the analytic model that leaves the least error of a transition, by a cross-entropy search."""
    rng = np.random.default_rng(seed)
    rows, columns = np.nonzero(pair.before_m)
    box = np.array([[columns.min(), CELLS - 1 - rows.max()], [columns.max() + 1, CELLS - rows.min()]]) * CELL_M
    low, high = np.concatenate([box[0] - BESIDE_M, LOW]), np.concatenate([box[1] + BESIDE_M, HIGH])
    tries = rng.uniform(low, high, (8 * TRIES, 6))
    best, error, predicted = tries[:1], float(pair.error_mm2(pair.before_m)), pair.before_m
    for _ in range(ROUNDS):
        after = np.concatenate([pushed(pair.before_m, some) for some in np.array_split(tries, len(tries) // 32)])
        errors = pair.error_mm2(after)
        order = np.argsort(errors)[:BEST]
        if errors[order[0]] < error:
            best, error, predicted = tries[order[:1]], float(errors[order[0]]), after[order[0]]
        chosen = np.concatenate([tries[order], best])
        spread = np.maximum(chosen.std(axis=0), 0.01 * (high - low))
        tries = np.clip(rng.normal(chosen[rng.integers(len(chosen), size=TRIES)], 0.5 * spread), low, high)
    return Found(best[0, :5], float(np.exp(best[0, 5])), predicted)


def pushed(before_m: FloatArray, tries: FloatArray) -> FloatArray:
    """Heights [K, H, W] after pushes [K, 6] of the search, by the base of the analytic model before any fit.

    The depth counts from the highest dough under the path, as a tool meets it, and ends at the table. Where there is
    none under the path, nothing changes.
    """
    action, count = tries[:, :5].copy(), len(tries)
    window = np.tile(np.array(WINDOW_M), (count, 1))
    along, across = local_places(window, before_m.shape, action=action, pixels_per_m=1 / CELL_M)
    after = np.empty((count, *before_m.shape))
    for k in range(count):  # one half-width a scene
        near = (np.abs(across[k]) < CELL_M) & (along[k] > -CELL_M) & (along[k] < action[k, 3] + CELL_M)
        top = float(before_m[near].max(initial=0.0))
        if top == 0:
            after[k] = before_m
            continue
        action[k, 4] = min(action[k, 4], top)
        scene = push_scene(
            (before_m - top)[None].astype(np.float32), along[k : k + 1], across[k : k + 1],
            worked=np.zeros((1, *before_m.shape), np.float32), action=action[k : k + 1], history_known=False,
            covariates={}, pixel_m=CELL_M, half_width_m=float(np.exp(tries[k, 5])),
        )  # fmt: skip
        model: AnalyticPush = first_model(scene)
        after[k] = np.maximum(before_m + model.change(scene)[0], 0.0)
    return after


def share(value: float, of: float) -> float:
    """Share of an error that is gone; negative where it grew."""
    return 1 - value / of


def interval(values: list[float]) -> tuple[float, float]:
    """Mean, and half the width of its 95 % interval (Student's t) as if the values were independent."""
    found = mean_interval(values)
    return found.value, found.high - found.value


def rise_mm(pair: Transition, after_m: FloatArray) -> float:
    """The 95th percentile of what rose by more than .5 mm; 0 where nothing did."""
    risen = after_m - pair.before_m
    risen = risen[risen > 0.0005]
    return float(1e3 * np.quantile(risen, 0.95)) if risen.size else 0.0


def volume_ml(heights_m: FloatArray) -> float:
    """Volume under a height map, millilitres."""
    return float(1e6 * heights_m.sum() * CELL_M**2)


def outside(pair: Transition) -> float:
    """Share of the dough's area after that lay beside the dough before."""
    after = pair.after_m > 0
    return float((after & (pair.before_m == 0)).sum() / after.sum())


def picture(pairs: list[Transition], found: list[Found]) -> NDArray[np.uint8]:
    """One row a transition: before, after, the best push."""
    window = np.array(WINDOW_M)
    rows = [
        np.hstack([photograph(h.astype(np.float32), window, 4) for h in (pair.before_m, pair.after_m, one.predicted_m)])
        for pair, one in zip(pairs, found, strict=True)
    ]
    thirds = [np.vstack(rows[k::3]) for k in range(3)]
    return np.hstack(thirds)


def page(pairs: list[Transition], others: list[FloatArray], found: list[Found], backwards: list[Found]) -> str:
    """The page in Markdown."""
    lines: list[str] = []
    gains, freedom, whole = list[float](), list[float](), list[float]()
    for pair, other, one, back in zip(pairs, others, found, backwards, strict=True):
        nothing = float(pair.error_mm2(pair.before_m))
        gain = share(float(pair.error_mm2(one.predicted_m)), nothing)
        control = share(float(pair.reverse.error_mm2(back.predicted_m)), nothing)
        gains.append(gain)
        freedom.append(control)
        if pair.tool not in CUT_OR_CARRIED:
            whole.append(gain - control)
        before, after, model = (volume_ml(h) for h in (pair.before_m, pair.after_m, one.predicted_m))
        lines.append(
            f"| {pair.tool} | {before:.0f} → {after:.0f} ml | {percent(outside(pair))} | {decimal(nothing)} | "
            f"{percent(share(float(pair.error_mm2(other)), nothing))} | {percent(gain)} | {percent(control)} | "
            f"{decimal(pair.sampling_mm2)} | {percent(model / before - 1)} / {percent(after / before - 1)} | "
            f"{rise_mm(pair, one.predicted_m):.1f} / {rise_mm(pair, pair.after_m):.1f} mm |"
        )
    said = {
        "gain": interval(gains),
        "freedom": interval(freedom),
        "difference": interval([a - b for a, b in zip(gains, freedom, strict=True)]),
        "whole": interval(whole),
    }
    texts = {name: f"{percent(mean)} ± {percent(half)}" for name, (mean, half) in said.items()}
    kept = [pair for pair in pairs if pair.tool not in CUT_OR_CARRIED]
    changes = [volume_ml(pair.after_m) / volume_ml(pair.before_m) - 1 for pair in kept]
    carried = max(
        (volume_ml(pair.after_m) / volume_ml(pair.before_m) - 1 for pair in pairs if pair.carried), default=0.0
    )
    return _PAGE.format(
        lines="\n".join(lines), count=len(pairs), kept=len(kept), kept_tools=", ".join(pair.tool for pair in kept),
        least=percent(min(changes)), most=percent(max(changes)), carried=percent(carried), **texts,
    )  # fmt: skip


_PAGE = """# RoboCook's real dough

Written by `python -m studies.sculpting.robocook --out docs`; do not edit. The clouds are of
[RoboCook](https://github.com/hshi74/robocook) (MIT) and are not part of this repository: `PENTIMENTO_MEASURED` names
their folder. Ten states of one piece of dough give {count} transitions, each by another tool. **No action is
recorded**, so no model can predict them. This page measures how much of each a single push *could* explain in
retrospect. (The authors' repository has actions of other transitions: [recording pushes](recording_pushes.md).)

Heights on cells of 4 mm, the highest point of each, above the lowest point of the pair; errors are squared, mm², summed
over the window, for each cell with dough before or after. *Mean of others*: the mean change of the other transitions.
*Best push*: the analytic model with the parameters of its start (nothing is fitted to dough); place, direction, length,
depth and width are fitted to the transition by a search. *Backwards* is a control: the same search on the reversed
transition, which no tool made, shows how much six free parameters fit by chance. *Halves*: the difference between two
halves of one cloud, a lower bound of the measurement's noise. Volume and rise (95th percentile where the dough rose):
by the best push / measured.

| tool | volume | dough on bare table | no change | mean of others | best push | backwards | halves | volume | rise |
|---|---|---|---|---|---|---|---|---|---|
{lines}

The best push removes {gain} of the error of no change, backwards {freedom}; paired, the difference is {difference}.
Of the {kept} transitions in which the dough stayed where it was and nothing was taken away ({kept_tools}) it is
{whole}.
Intervals are Student's t of 95 %, as if the transitions were independent.

Before, after, and the best push; from left to right and then down:

![dough](sculpting/robocook.png)

What the model misses:

- **A free edge.** The studio's slab fills its tray. This dough stands on a table and spreads onto it: the column *dough
  on bare table* is the area after that was bare before. The model heaps what it displaces around the tool, within a
  footprint or two, and does not let a side slump.
- **Whole-body deformation.** A press, a roller and a gripper move all of the dough at once; the model moves what its
  tool touches.
- **Rise.** Where dough rose, the best push raises it by less than half of the measured rise, with every tool.
- **Cutting and carrying.** Cutters separate, the pusher and the spatulas take dough away or carry it off. No action of
  this project does.

What these transitions cannot tell:

- **The floor.** Nothing is repeated. Halves of a cloud differ by the sampling alone; the cameras' error, and how far
  the same action would differ the next time, are unknown.
- **The volume.** In the {kept} transitions that neither add nor take away, the measured volume changes by {least} to
  {most}, and carrying it with a spatula changes it by {carried}. The clouds were filled in by their authors, the
  table's height is not recorded, and thin dough is sparse: a smaller bias of the model's volume cannot be detected.
- **Single actions.** Between two states the tool may have been used several times, and the actions are unknown.
- **Other dough.** All states are of one piece of dough, so the transitions are not independent and the intervals are
  probably too narrow. Each tool occurs once, so tools cannot be compared.
"""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m studies.sculpting.robocook", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    main(parser.parse_args())
