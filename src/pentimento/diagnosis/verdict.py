"""What verdict, leaderboard and figures need of a diagnosis, whatever was diagnosed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

from numpy.typing import NDArray

from pentimento.diagnosis.evaluation import Floor
from pentimento.diagnosis.residual_structure import TemporalDrift, Unexplained
from pentimento.diagnosis.score import Step

Array = NDArray[Any]

SCHEMA = 1
NEXT_ACTIONS = "next_actions.parquet"
_MAX_UNEXPLAINED = 12


class Kind(NamedTuple):
    """What the rows are."""

    name: str
    """Of the table, and of its rows in a sentence."""
    unit: str
    """Of mean squared errors."""


STROKES = Kind("strokes", "sRGB")
PUSHES = Kind("pushes", "mm²")


class Searched(Protocol):
    """See ``diagnosis.strokes.search.Search``."""

    @property
    def steps(self) -> tuple[Step, ...]:
        """Rounds of the search."""

    @property
    def not_observable(self) -> dict[str, str]:
        """Causes that could not be looked for, and why."""


class Told(Protocol):
    """A mechanism of strokes or of pushes."""

    cause: ClassVar[str]

    @property
    def informative_covariates(self) -> tuple[str, ...]:
        """Columns that its effect goes with."""


class Extended(Protocol):
    """A model with the established causes."""

    @property
    def mechanisms(self) -> Sequence[Told]:
        """One for each cause."""


class DiagnosisResult(Protocol):
    """See ``diagnosis.strokes.diagnose.Diagnosis``."""

    @property
    def extended(self) -> Extended:
        """The base with the established causes."""

    @property
    def search(self) -> Searched:
        """How causes were found."""

    @property
    def established(self) -> tuple[Finding, ...]:
        """Causes."""

    @property
    def suspected(self) -> tuple[Finding, ...]:
        """Causes."""

    @property
    def floor(self) -> Floor | None:
        """None where no action is repeated."""

    @property
    def drifts(self) -> TemporalDrift | None:
        """What neighbours in time share: a state that nobody recorded, unless a recorded column goes with it."""

    @property
    def base_losses(self) -> Array:
        """Of each sealed action."""

    @property
    def extended_losses(self) -> Array:
        """Of each sealed action."""

    @property
    def gap_closed(self) -> tuple[float, tuple[float, float]] | None:
        """Share, and 95 % of it."""

    @property
    def unexplained(self) -> tuple[Unexplained, ...]:
        """What is left."""


@dataclass(frozen=True)
class Finding:
    """One cause, with what it is worth on sealed strokes."""

    cause: str
    p_adjusted: float
    confirmed_p: float
    gain: float
    """Share that it removes of the base's error above the floor; of strokes a tenth of the error counts as such at
    least, of pushes all of it where nothing is above."""
    gain_interval: tuple[float, float]
    values: dict[str, tuple[float, float]]
    """Each quantity with its standard error."""
    rivals: tuple[str, ...]
    misattributed: bool = False
    """Whether it is no better than what has no name."""
    of_what_is_left: float = math.nan
    """What it removes as a share not of the gap but of what of this all other established causes leave; NaN where
    nothing but the gap was asked for."""
    missed_without: float = math.nan
    """Mean squared error that the model leaves on sealed strokes without it; NaN where that is not known."""


def verdict(
    diagnosis: DiagnosisResult,
    rows: int,
    actions: int,
    shifted: float | None = None,
    notes: Sequence[str] = (),
    given_mse: float | None = None,
    kind: Kind = STROKES,
) -> dict[str, Any]:
    """What ``verdict.json`` holds. Errors are of sealed rows, over the whole window: sRGB in [0, 1] squared, or mm².

    What is not known (a floor without repeats, a gap without a floor) is None.

    Args:
        diagnosis: what was found.
        rows: how many could be used.
        actions: how many different ones they are.
        shifted: share of the gap closed on an outside table.
        notes: sentences to go with the verdict's own: what was left out of the table.
        given_mse: of a model that was named, on the sealed rows; becomes ``mse.given``.
        kind: what the rows are.
    """
    floor, closed = diagnosis.floor, diagnosis.gap_closed
    extended = float(diagnosis.extended_losses.mean())
    made: dict[str, Any] = {
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
        made["mse"]["given"] = given_mse
    if diagnosis.drifts:
        mode, p, mse, mse_of_repeats, _ = diagnosis.drifts
        made["drifts"] = {"mode": mode, "p": p, "mse": mse, "mse_of_repeats": mse_of_repeats}
    known: dict[str, Any] = _without_nan(made)
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
    """One paragraph."""
    base, extended = diagnosis.base_losses.mean(), diagnosis.extended_losses.mean()
    said = [f"On sealed {kind.name} the base model misses by {base:.3g} (mean squared, {kind.unit})."]
    if diagnosis.established:
        named = "; ".join(_named(finding, diagnosis.floor is not None) for finding in diagnosis.established)
        said.append(f"Established: {named}. With that the error is {extended:.3g}.")
    else:
        said.append("No known cause is established.")
    if doubtful := [finding.cause for finding in diagnosis.suspected if not finding.misattributed]:
        said.append(f"Suspected, not confirmed on {kind.name} that had no part in the search: {', '.join(doubtful)}.")
    if misattributed := [finding.cause for finding in diagnosis.suspected if finding.misattributed]:
        said.append(f"No better than what has no name, and so not named: {', '.join(misattributed)}.")
    if diagnosis.floor is None:
        said.append("No action is repeated often enough, so the noise floor is unknown.")
    else:
        said.append(f"The noise floor, from repeated actions, is {diagnosis.floor.mse:.3g}.")
        if diagnosis.gap_closed is not None and diagnosis.established:
            said.append(f"{diagnosis.gap_closed[0]:.0%} of the gap above it is closed.")
    if diagnosis.unexplained:
        said.append(_structured(diagnosis))
    else:
        if drifts := diagnosis.drifts:
            said.append(
                f"In the order of execution {drifts.mode} wanders, worth {drifts.mse:.3g}, and nothing that was "
                "recorded goes with it."
            )
        if diagnosis.floor is not None and extended > diagnosis.floor.interval[1]:
            said.append("Gap above the floor, cause not observable in what was recorded.")
    said += _not_observable(diagnosis.search.not_observable)
    rivals = [(finding.cause, rival) for finding in diagnosis.established for rival in finding.rivals]
    if rivals:
        pairs = ", ".join(f"{cause} from {rival}" for cause, rival in rivals)
        said.append(f"To tell {pairs}, make the {kind.name} of {NEXT_ACTIONS}.")
    return " ".join(said)


def _structured(diagnosis: DiagnosisResult) -> str:
    """What the first of what is unexplained depends on, and what established causes say of that already."""
    mode, covariate = diagnosis.unexplained[0].mode, diagnosis.unexplained[0].covariate
    told = [
        mechanism.cause for mechanism in diagnosis.extended.mechanisms if covariate in mechanism.informative_covariates
    ]
    known = "established" if diagnosis.suspected else "known"
    if told:
        beyond = f"beyond what is established of it ({', '.join(told)}); no other {known} cause explains that"
        return f"Structured residual: {mode} depends on {covariate}, {beyond}."
    return f"Structured residual: {mode} depends on {covariate}; no {known} cause explains it."


def _named(finding: Finding, floor_known: bool) -> str:
    numbers = ", ".join(f"{name} {value:.3g} ± {error:.1g}" for name, (value, error) in finding.values.items())
    rivals = f"; rivals {', '.join(finding.rivals)}" if finding.rivals else ""
    whole = "gap" if floor_known else "error"
    return f"{finding.cause} ({numbers}; removes {finding.gain:.0%} of the {whole}{rivals})"


def _not_observable(reasons: dict[str, str]) -> list[str]:
    """A sentence for each reason why causes could not be looked for."""
    by_reason: dict[str, list[str]] = {}
    for cause, reason in reasons.items():
        by_reason.setdefault(reason.rstrip("."), []).append(cause)
    return [f"Not decided, because {reason}: {', '.join(causes)}." for reason, causes in by_reason.items()]


def _of_a_given_model(diagnosis: DiagnosisResult, mse: float | None) -> list[str]:
    """How it stands to the finder's base, which differs from it in nothing but how free it is."""
    if mse is None:
        return []
    base = float(diagnosis.base_losses.mean())
    said = f"The given model misses the same strokes by {mse:.3g}"
    if base < mse:
        return [f"{said}: {1 - base / mse:.0%} of that is calibration, which the base takes up without any cause."]
    return [f"{said}, no more than the base."]


def _on_an_outside_table(shifted: float | None) -> list[str]:
    return [] if shifted is None else [f"On the outside table {shifted:.0%} of the gap is closed."]


def _without_nan(value: Any) -> Any:
    """JSON knows no NaN and no infinity: unknown."""
    if isinstance(value, dict):
        return {name: _without_nan(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
