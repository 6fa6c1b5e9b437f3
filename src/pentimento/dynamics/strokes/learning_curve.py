"""Learning curve of the stroke model: held-out error over growing shares of the strokes, and when they are enough.

Shares are nested and double in size; the held-out actions are always the same. The gain of a doubling is the relative
fall of their mean error, with an interval from a paired bootstrap over held-out actions. The strokes are enough when
even the upper end of the interval is a small gain. A curve whose error rises beyond its interval is unsure: more
strokes of the same kind do no harm, so that one of its fits has failed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.contracts.statistics import interval, resamples
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.dynamics.strokes.evaluation import predict_with
from pentimento.dynamics.strokes.resolution import AUTO, Sampling
from pentimento.dynamics.strokes.samples import StrokeSamples, load_samples, sampling_of
from pentimento.dynamics.strokes.training import TrainingConfig, split_by_action, train

ENOUGH_GAIN: Final = 0.05
"""Relative gain of a doubling below which more strokes are not worth recording."""

_TRAINING: Final = TrainingConfig(
    path_points=32, pixels_per_m=AUTO, margin_m=AUTO, epochs=25, batch=16, learning_rate=0.03, ink_weight=2.0,
    held_out=0.25, seed=0,
)  # fmt: skip
_MIN_ACTIONS: Final = 8
_STEPS: Final = 4
_MIN_STEPS: Final = 120
"""Steps of the optimiser, so that a model of a small share is not trained for less long."""
_DRAWS: Final = 4000

Array = NDArray[np.float64]


class Gain(NamedTuple):
    """Gain of one doubling: the relative fall of the held-out error, with a 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class LearningCurve:
    """Held-out error over the number of training strokes."""

    strokes: tuple[int, ...]
    """Rows in each share."""
    actions: tuple[int, ...]
    mse: tuple[float, ...]
    """Held-out, mean over actions, sRGB in [0, 1]."""
    blank: float
    """The same error of predicting no change."""
    gains: tuple[Gain, ...]
    """Of each share over the one before it."""
    held_out: int
    """Actions."""

    @property
    def rise(self) -> int | None:
        """The first doubling whose error surely rose, as an index of `gains`; None where the curve is monotone."""
        return next((at for at, gain in enumerate(self.gains) if gain.high < 0), None)

    @property
    def enough(self) -> int | None:
        """Strokes after which no doubling can have gained `ENOUGH_GAIN`; None where the last one may, or if unsure."""
        if self.rise is not None or self.gains[-1].high >= ENOUGH_GAIN:
            return None
        settled = len(self.gains)
        while settled and self.gains[settled - 1].high < ENOUGH_GAIN:
            settled -= 1
        return self.strokes[settled]

    @property
    def sentence(self) -> str:
        """The conclusion in a sentence."""
        last, share = self.gains[-1], round(100 * ENOUGH_GAIN)
        if self.rise is not None:
            worse = self.gains[self.rise]
            return (
                f"Unsure: from {self.strokes[self.rise]} to {self.strokes[self.rise + 1]} strokes the error rises by "
                f"{-100 * worse.value:.1f} % (95 %: {-100 * worse.high:.1f} % to {-100 * worse.low:.1f} %). More "
                "strokes do no harm, so one of the fits has failed, and the curve gives no advice. Try another --seed; "
                "if it stays so, look at the photographs and at color_srgb."
            )
        gained = (
            f"the last doubling gained {_percent(last.value)} (95 %: {_percent(last.low)} to {_percent(last.high)})"
        )
        if self.enough is not None:
            return f"{self.enough} strokes are enough for this model: {gained}, less than {share} %."
        if last.low > ENOUGH_GAIN:
            return f"More strokes make a better model: {gained}, more than {share} %."
        return f"Undecided: {gained}, and {share} % lies between. Record more, or stop where time is dear."

    def lines(self) -> list[str]:
        """The curve as a table in text."""
        rows = [("strokes", "actions", "held-out MSE", "gain of the doubling (95 %)")]
        gains = ["", *(f"{_percent(g.value)} ({_percent(g.low)} to {_percent(g.high)})" for g in self.gains)]
        for count, actions, error, gain in zip(self.strokes, self.actions, self.mse, gains, strict=True):
            rows.append((str(count), str(actions), f"{error:.6f}", gain))
        rows.append(("none", "", f"{self.blank:.6f}", "no change predicted"))
        return [f"{a:>8} {b:>8} {c:>13}  {d}".rstrip() for a, b, c, d in rows]


def learning_curve_of(rows: Path, seed: int) -> tuple[LearningCurve, Sampling]:
    """The curve of a table in the strokes contract (a file or a folder of shards), and how photographs were sampled.

    Raises:
        ContractError: the table cannot be read, shows no ink, or has too few actions for a curve.
    """
    table = read_table(rows, CONTRACT).table
    if table.num_rows == 0:
        raise ContractError(f"{rows} holds no strokes; record some.")
    sampling = sampling_of(table, _TRAINING.pixels_per_m, _TRAINING.margin_m)
    samples = load_samples(table, _TRAINING.path_points, sampling.pixels_per_m, sampling.margin_m)
    return learning_curve(samples, seed), sampling


def learning_curve(samples: StrokeSamples, seed: int) -> LearningCurve:
    """Held-out error of Traj2Stroke over nested, doubling shares of the training actions.

    Raises:
        ContractError: fewer than two shares of 8 actions fit into the training part.
    """
    training, held_out = split_by_action(samples, _TRAINING.held_out, seed)
    actions = np.random.default_rng([seed, 1]).permutation(np.unique(training.action.numpy()))
    counts = _counts(len(actions))
    if len(counts) < 2:
        raise ContractError(
            f"{len(actions)} actions are left to train on when a quarter is held out; a learning curve needs "
            f"{2 * _MIN_ACTIONS} of them at least: record more strokes."
        )
    errors, rows = [], []
    for count in counts:
        part = training.pick(_among(training, actions[:count]))
        errors.append(_action_errors(_predicted(part, held_out, seed), held_out))
        rows.append(len(part.path))
    blank = _action_errors(held_out.before.numpy(), held_out)
    gains = tuple(_gain(before, after, seed) for before, after in pairwise(errors))
    means = tuple(float(error.mean()) for error in errors)
    return LearningCurve(tuple(rows), tuple(counts), means, float(blank.mean()), gains, len(blank))


def _counts(actions: int) -> list[int]:
    """All of them, half, a quarter, ..., as long as they are enough to fit anything; the smallest first."""
    counts = [round(actions / 2**halving) for halving in range(_STEPS)]
    return sorted(count for count in counts if count >= _MIN_ACTIONS)


def _among(samples: StrokeSamples, actions: NDArray[Any]) -> Any:
    index = np.flatnonzero(np.isin(samples.action.numpy(), actions))
    return samples.action.new_tensor(index)


def _predicted(part: StrokeSamples, held_out: StrokeSamples, seed: int) -> NDArray[Any]:
    steps_an_epoch = max(1, -(-len(part.path) // _TRAINING.batch))
    epochs = max(_TRAINING.epochs, -(-_MIN_STEPS // steps_an_epoch))
    config = replace(_TRAINING, epochs=epochs, seed=seed)
    model = train(part, config, lambda *_: None)
    return np.asarray(predict_with(model.parameters_si(), held_out).numpy())


def _action_errors(predicted: NDArray[Any], samples: StrokeSamples) -> Array:
    """Mean squared error of each action's strokes over their windows, [A]."""
    valid = samples.valid.numpy()
    squared = np.square(predicted - samples.after.numpy()).mean(-1) * valid
    each = squared.sum((1, 2)) / valid.sum((1, 2))
    actions = samples.action.numpy()
    return np.array([each[actions == action].mean() for action in np.unique(actions)], dtype=np.float64)


def _gain(before: Array, after: Array, seed: int) -> Gain:
    """1 - error after / error before, with a paired bootstrap over actions."""
    drawn = resamples(len(before), _DRAWS, [seed, 2])
    return Gain(float(1 - after.mean() / before.mean()), *interval(1 - after[drawn].mean(1) / before[drawn].mean(1)))


def _percent(share: float) -> str:
    return f"{100 * share:+.1f} %"
