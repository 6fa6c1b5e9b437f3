"""The result of a diagnosis, and its verdict: numbers and one paragraph (schema 1, docs/diagnosis.md §13)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

from numpy.typing import NDArray

from pentimento.diagnosis.evaluation import Floor, fraction_of_gap
from pentimento.diagnosis.residual_structure import Unexplained
from pentimento.diagnosis.score import Step
from pentimento.diagnosis.temporal_drift import TemporalDrift

Array = NDArray[Any]

SCHEMA = 1
NEXT_ACTIONS = "next_actions.parquet"
"""File with the proposed actions."""
_MAX_UNEXPLAINED = 12
"""Pairs of mode and covariate that are listed."""


class Kind(NamedTuple):
    """What the rows are."""

    name: str
    """Of the table, and of its rows in a sentence."""
    unit: str
    """Of mean squared errors."""


STROKES = Kind("strokes", "sRGB")
PUSHES = Kind("pushes", "mm²")


class Selection(Protocol):
    """Outcome of the selection of causes."""

    @property
    def steps(self) -> tuple[Step, ...]:
        """Rounds of forward selection."""

    @property
    def not_observable(self) -> dict[str, str]:
        """Causes that these rows cannot show, and why."""


class NamedMechanism(Protocol):
    """A mechanism of strokes or pushes."""

    cause: ClassVar[str]

    @property
    def informative_covariates(self) -> tuple[str, ...]:
        """Covariates that its effect depends on."""


class ExtendedModel(Protocol):
    """A model with mechanisms."""

    @property
    def mechanisms(self) -> Sequence[NamedMechanism]:
        """One for each cause."""


@dataclass(frozen=True)
class Finding:
    """One cause with its gain on the test split."""

    cause: str
    p_adjusted: float
    confirmed_p: float
    gain: float
    """Share of the base's error above the floor that it removes. For strokes at least a tenth of the error counts as
    above the floor; for pushes all of it where nothing is above."""
    gain_interval: tuple[float, float]
    values: dict[str, tuple[float, float]]
    """Each quantity with its standard error."""
    rivals: tuple[str, ...]
    misattributed: bool = False
    """Whether it is not better than an effect without a name."""
    of_what_is_left: float = math.nan
    """The gain relative to what all other established causes leave of the gap; NaN where this is not needed."""
    missed_without: float = math.nan
    """Error of the model without it on the test split; NaN where unknown."""


@dataclass(frozen=True, kw_only=True)
class DiagnosisResult:
    """What verdict, report and design need of a diagnosis of strokes or pushes."""

    search: Selection
    extended: ExtendedModel
    """The base with the established causes."""
    established: tuple[Finding, ...]
    suspected: tuple[Finding, ...]
    floor: Floor | None
    """None where too few actions are repeated."""
    drifts: TemporalDrift | None
    """Unmodelled temporal drift."""
    base_losses: Array
    """Error of the base on each action of the test split."""
    extended_losses: Array
    """Error of the extended model likewise."""
    unexplained: tuple[Unexplained, ...]
    mode_strength: Array
    """[modes, covariates] strength of all pairs, |t|."""
    covariates: tuple[str, ...]

    @property
    def smallest_gap(self) -> float:
        """A gap up to this size is not measurable."""
        return 0.0

    @property
    def gap_closed(self) -> tuple[float, tuple[float, float]] | None:
        """(base - extended) / (base - floor) on the test split, with its 95 % interval; None without a gap or floor."""
        if self.floor is None or self.base_losses.mean() - self.floor.mse <= self.smallest_gap:
            return None
        return fraction_of_gap(self.base_losses, self.extended_losses, self.floor.mse)


def verdict(
    diagnosis: DiagnosisResult,
    rows: int,
    actions: int,
    *,
    shifted: float | None = None,
    notes: Sequence[str] = (),
    given_mse: float | None = None,
    kind: Kind = STROKES,
) -> dict[str, Any]:
    """The content of ``verdict.json``. Errors are over the whole windows of the test split: sRGB in [0, 1] squared, or
    mm².

    Unknown values (a floor without repeats, a gap without a floor) are None.

    Args:
        diagnosis: the result.
        rows: number of rows that could be used.
        actions: number of different actions.
        shifted: fraction of the gap closed on an outside table.
        notes: sentences that are appended: what was left out of the table.
        given_mse: error of a user-supplied baseline model on the test split; becomes ``mse.given``.
        kind: of the rows.
    """
    floor, closed = diagnosis.floor, diagnosis.gap_closed
    extended = float(diagnosis.extended_losses.mean())
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "kind": kind.name,
        "rows": rows,
        "actions": actions,
        "mse": {
            "base": float(diagnosis.base_losses.mean()),
            "extended": extended,
            "floor": floor and floor.mse,
            "floor_ci": floor and list(floor.interval),
        },
        "established": [_entry(finding) for finding in diagnosis.established],
        "suspected": [_entry(finding) for finding in diagnosis.suspected],
        "gap_closed": {"test": closed and closed[0], "ci": closed and list(closed[1]), "shifted": shifted},
        "unexplained": [left._asdict() for left in diagnosis.unexplained[:_MAX_UNEXPLAINED]],
        "floor_reached": None if floor is None else floor.interval[0] <= extended <= floor.interval[1],
        "next_actions": NEXT_ACTIONS,
        "sentence": " ".join(
            [
                sentence(diagnosis, kind),
                *_of_a_given_model(diagnosis, given_mse),
                *_on_an_outside_table(shifted),
                *notes,
            ]
        ),
    }
    if given_mse is not None:
        content["mse"]["given"] = given_mse
    if diagnosis.drifts:
        mode, p, mse, mse_of_repeats, _ = diagnosis.drifts
        content["drifts"] = {"mode": mode, "p": p, "mse": mse, "mse_of_repeats": mse_of_repeats}
    known: dict[str, Any] = _without_nan(content)
    return known


def _entry(finding: Finding) -> dict[str, Any]:
    return {
        "cause": finding.cause,
        "p_adj": finding.p_adjusted,
        "gain": finding.gain,
        "gain_ci": list(finding.gain_interval),
        "parameters": {name: {"value": value, "se": error} for name, (value, error) in finding.values.items()},
        "rivals": list(finding.rivals),
    }


def sentence(diagnosis: DiagnosisResult, kind: Kind = STROKES) -> str:
    """The verdict as one paragraph."""
    base, extended = diagnosis.base_losses.mean(), diagnosis.extended_losses.mean()
    parts = [f"On the test split the base model has an error of {base:.3g} (mean squared, {kind.unit})."]
    if diagnosis.established:
        named = "; ".join(_named(finding, diagnosis.floor is not None) for finding in diagnosis.established)
        parts.append(f"Established: {named}. With that the error is {extended:.3g}.")
    else:
        parts.append("No known cause is established.")
    if unconfirmed := [finding.cause for finding in diagnosis.suspected if not finding.misattributed]:
        parts.append(f"Suspected, but not confirmed: {', '.join(unconfirmed)}.")
    if misattributed := [finding.cause for finding in diagnosis.suspected if finding.misattributed]:
        parts.append(f"Not better than an effect without a name, and so not established: {', '.join(misattributed)}.")
    if diagnosis.floor is None:
        parts.append("No action is repeated often enough, so the noise floor is unknown.")
    else:
        parts.append(f"The noise floor, from repeated actions, is {diagnosis.floor.mse:.3g}.")
        if diagnosis.gap_closed is not None and diagnosis.established:
            parts.append(f"{diagnosis.gap_closed[0]:.0%} of the gap above it is closed.")
    if diagnosis.unexplained:
        parts.append(_structured(diagnosis))
    else:
        if drifts := diagnosis.drifts:
            parts.append(
                f"Temporal drift: {drifts.mode} drifts in the order of execution (error {drifts.mse:.3g}), and no "
                "recorded covariate correlates with it."
            )
        if diagnosis.floor is not None and extended > diagnosis.floor.interval[1]:
            parts.append("Gap above the floor, cause not observable in what was recorded.")
    parts += _not_observable(diagnosis.search.not_observable)
    rivals = [(finding.cause, rival) for finding in diagnosis.established for rival in finding.rivals]
    if rivals:
        pairs = ", ".join(f"{cause} from {rival}" for cause, rival in rivals)
        parts.append(f"To separate {pairs}, execute the {kind.name} of {NEXT_ACTIONS}.")
    return " ".join(parts)


def _structured(diagnosis: DiagnosisResult) -> str:
    """The strongest unexplained dependence, and the established causes that share its covariate."""
    mode, covariate = diagnosis.unexplained[0].mode, diagnosis.unexplained[0].covariate
    sharing = [
        mechanism.cause for mechanism in diagnosis.extended.mechanisms if covariate in mechanism.informative_covariates
    ]
    known = "established" if diagnosis.suspected else "known"
    if sharing:
        beyond = f"beyond its established effect ({', '.join(sharing)}); no other {known} cause explains that"
        return f"Structured residual: {mode} depends on {covariate}, {beyond}."
    return f"Structured residual: {mode} depends on {covariate}; no {known} cause explains it."


def _named(finding: Finding, floor_known: bool) -> str:
    numbers = ", ".join(f"{name} {value:.3g} ± {error:.1g}" for name, (value, error) in finding.values.items())
    rivals = f"; rivals {', '.join(finding.rivals)}" if finding.rivals else ""
    whole = "gap" if floor_known else "error"
    return f"{finding.cause} ({numbers}; removes {finding.gain:.0%} of the {whole}{rivals})"


def _not_observable(reasons: dict[str, str]) -> list[str]:
    """One sentence for each reason why causes could not be tested."""
    by_reason: dict[str, list[str]] = {}
    for cause, reason in reasons.items():
        by_reason.setdefault(reason.rstrip("."), []).append(cause)
    return [f"Not decided, because {reason}: {', '.join(causes)}." for reason, causes in by_reason.items()]


def _of_a_given_model(diagnosis: DiagnosisResult, mse: float | None) -> list[str]:
    """Its error compared with the base, which differs by its free nuisances only."""
    if mse is None:
        return []
    base = float(diagnosis.base_losses.mean())
    result = f"The given model has an error of {mse:.3g} on the same strokes"
    if base < mse:
        return [
            f"{result}: {1 - base / mse:.0%} of that is calibration, which the free base removes without any cause."
        ]
    return [f"{result}, no more than the base."]


def _on_an_outside_table(shifted: float | None) -> list[str]:
    return [] if shifted is None else [f"On the outside table {shifted:.0%} of the gap is closed."]


def _without_nan(value: Any) -> Any:
    """The value with None for NaN and infinity, which JSON lacks."""
    if isinstance(value, dict):
        return {name: _without_nan(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
