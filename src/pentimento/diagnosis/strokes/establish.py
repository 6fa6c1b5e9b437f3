"""Which selected causes are established: by their gain on the test split and the misattribution checks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from pentimento.diagnosis.evaluation import SMALLEST_GAP, Floor, mean_gain
from pentimento.diagnosis.strokes.candidates import can_mimic, form_error_share
from pentimento.diagnosis.strokes.fit import fit, values_with_errors
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.misattribution import (
    generic_curve_suffices,
    shows_signature,
    trails_both_ways,
    trails_by_another_power,
)
from pentimento.diagnosis.strokes.model import Model, UnevenEnds
from pentimento.diagnosis.strokes.predict import action_losses
from pentimento.diagnosis.strokes.search import Search
from pentimento.diagnosis.temporal_drift import TemporalDrift
from pentimento.diagnosis.verdict import Finding
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_SURE_P = 0.01
"""Confirmation p of a cause that a small test split must not contradict."""
_CERTAIN_P = 0.001
"""Confirmation p beyond doubt."""
_MIN_GAIN = 0.02
"""Minimum gain on the test split, as a share of the gap."""
_MIN_BESIDE = 0.05
"""Minimum gain as a share of the gain of another cause that this one can mimic. Where a cause's form is not exact,
another one explains a little of its error."""
_FAINT = 0.5
"""The minimum gain is lowered by this factor where both confirmation and test split are certain."""
_GOOD_GAIN = 0.1
"""A smaller gain must be significant on the test split: a base with a wrong profile leaves a little of everything."""
_FEW = 15
"""Actions of the test split below which it cannot tell a small gain from none."""
_SURELY_THERE = 2.0
"""Standard errors from 0 of a cause's only quantity."""


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Everything that the decision about selected causes depends on."""

    found: Search
    confirmed_p: dict[str, float]
    base: Model
    """Fitted to ``known``."""
    extended: Model
    """The base with the confirmed causes, fitted to ``known``."""
    measured: Measured
    """All strokes."""
    known: Measured
    """The strokes outside the test split."""
    test: Measured
    """The test split."""
    floor: Floor | None
    drifts: TemporalDrift | None
    base_losses: Array
    """Error of the base on each action of the test split."""
    seed: int

    @property
    def selected(self) -> list[Mechanism]:
        """The mechanisms of the selected causes."""
        return [m for m in self.found.model.mechanisms if not isinstance(m, UnevenEnds)]

    def above_floor(self, mse: float) -> float:
        """The part of an error above the noise floor, at least a tenth of the error."""
        return max(mse - self.floor.mse, SMALLEST_GAP * mse) if self.floor else mse

    def without(self, model: Model, causes: Sequence[str]) -> Model:
        """The model without some causes, fitted to ``known``."""
        rest = without_causes(model, causes, self.base)
        return fit(rest, self.known) if any(m.cause in self.found.observable for m in rest.mechanisms) else self.base


@dataclass(frozen=True)
class Decision:
    """Which selected causes are established."""

    extended: Model
    established: tuple[Finding, ...]
    suspected: tuple[Finding, ...]


def decide(problem: Problem, log: Callable[[str], None]) -> Decision:
    """Which of the confirmed causes are established, by their gain and the misattribution checks."""
    extended = problem.extended
    established = _findings(problem, extended)
    # One at a time: of two causes that can each replace the other, neither has a gain beside the other.
    while useless := [
        f for f in established if not _is_of_use(f, established, problem.found, len(problem.base_losses))
    ]:
        worst = min(useless, key=lambda f: f.gain)
        extended = problem.without(extended, [worst.cause])
        established = _findings(problem, extended)
    misattributed = [f.cause for f in established if _is_misattributed(problem, extended, f)]
    if misattributed:
        log(f"not better than an effect without a name: {', '.join(misattributed)}")
        extended = problem.without(extended, misattributed)
        established = _findings(problem, extended)
    names = {f.cause for f in established}
    # An established cause is no alternative explanation of another one.
    established = tuple(replace(f, rivals=tuple(r for r in f.rivals if r not in names)) for f in established)
    suspected = tuple(
        replace(
            _finding(problem, fit(extended.plus(m), problem.known), m), misattributed=m.cause in misattributed
        )
        for m in problem.selected
        if m.cause not in names
    )  # fmt: skip
    return Decision(extended, established, suspected)


def _findings(problem: Problem, model: Model) -> tuple[Finding, ...]:
    return tuple(_finding(problem, model, m) for m in model.mechanisms if not isinstance(m, UnevenEnds))


def _finding(problem: Problem, model: Model, mechanism: Mechanism) -> Finding:
    """A cause of the model with its gain: the error that returns on the test split without it."""
    cause = mechanism.cause
    losses = action_losses(problem.without(model, [cause]), problem.test)
    above = problem.above_floor(float(problem.base_losses.mean()))
    gain, interval = mean_gain((losses - action_losses(model, problem.test)) / above, problem.seed)
    step = next(step for step in reversed(problem.found.steps) if step.chosen == cause)
    return Finding(
        cause=cause,
        p_adjusted=step.evidence[cause].p_adjusted,
        confirmed_p=problem.confirmed_p[cause],
        gain=gain,
        gain_interval=interval,
        values=values_with_errors(model, mechanism, problem.known),
        rivals=step.rivals,
        of_what_is_left=gain * above / problem.above_floor(float(losses.mean())),
        missed_without=float(losses.mean()),
    )


def _is_misattributed(problem: Problem, extended: Model, finding: Finding) -> bool:
    """Whether a cause of the extended model only stands in for an effect without a name."""
    mechanism, seed = problem.found.observable[finding.cause], problem.seed
    return (
        not shows_signature(mechanism, finding.values)
        or trails_by_another_power(mechanism, extended, problem.known)
        or trails_both_ways(mechanism, extended, problem.measured)
        or generic_curve_suffices(
            mechanism,
            extended,
            problem.without(extended, [finding.cause]),
            known=problem.known,
            test_split=problem.test,
            seed=seed,
        )
    )


def _is_of_use(finding: Finding, established: Sequence[Finding], found: Search, test_actions: int) -> bool:
    """Whether a cause acts, with a possible sign, and gains enough on the test split.

    A small test split cannot tell a small gain from none. There, a cause that the confirmation split supports, and that
    no other established cause can mimic, need only have a positive gain, or one that is not small beside the others.

    Args:
        finding: of the cause.
        established: all findings.
        found: the selection.
        test_actions: number of actions in the test split.
    """
    mechanism = found.observable[finding.cause]
    if any(not q.signed and finding.values[q.name][0] < 0 for q in mechanism.quantities):
        return False
    if len(mechanism.quantities) == 1:  # several quantities may each be uncertain and jointly certain
        ((value, error),) = finding.values.values()
        if abs(value) < _SURELY_THERE * error:
            return False
    mimics = [f for f in established if f is not finding and can_mimic(found.observable[f.cause], mechanism)]
    sure = finding.confirmed_p <= _SURE_P and not mimics and test_actions <= _FEW
    if sure and len(established) == 1:
        return finding.gain > 0
    beyond_doubt = finding.confirmed_p <= _CERTAIN_P and finding.gain_interval[0] > 0
    minimum = _FAINT * _MIN_GAIN if beyond_doubt else _MIN_GAIN
    if (finding.of_what_is_left if beyond_doubt else finding.gain) < minimum:
        return False
    for other in mimics:
        share = form_error_share(found.observable[other.cause], mechanism) if beyond_doubt else _MIN_BESIDE
        if finding.gain < other.gain * min(share, _MIN_BESIDE):
            return False
    if finding.confirmed_p <= _CERTAIN_P:
        return True
    largest = max(f.gain for f in established)
    good = _GOOD_GAIN * largest if sure else max(_GOOD_GAIN, _MIN_BESIDE * largest)
    return finding.gain >= good or finding.gain_interval[0] > 0


def without_causes(model: Model, causes: Sequence[str], base: Model) -> Model:
    """The model without some causes, with the base's uneven ends where one of the causes had replaced them.

    Otherwise a cause would be credited with what the base does without it.
    """
    rest = model.without(*causes)
    if not causes or any(isinstance(m, UnevenEnds) for m in rest.mechanisms):
        return rest
    return rest.plus(*(m for m in base.mechanisms if isinstance(m, UnevenEnds)))
