"""The stroke model that planning uses: Traj2Stroke, the causes that a diagnosis established, and a learned correction.

Its causes are mechanisms of the vocabulary with the values of a joint fit. The correction (``correction``) is fitted
last. Without either the model is Traj2Stroke.
``path_scale`` and ``path_offset`` are never among them: they are parameters of Traj2Stroke (the thesis's m and b).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from pentimento.contracts.codec import from_plain, to_plain
from pentimento.contracts.errors import ContractError
from pentimento.dynamics.strokes.correction import MarkCorrection, read_correction
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.photometry import linear_to_srgb, srgb_to_linear
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.simulation import Mechanism, StrokeContext, simulate
from pentimento.dynamics.strokes.traj2stroke import Mark, Traj2Stroke, Traj2StrokeParameters, read_parameters
from pentimento.planning.strokes.brush import Span, StrokeTiming

BASE_CAUSES = ("path_scale", "path_offset")
"""Causes that are parameters of Traj2Stroke."""
_PAINTED = 0.15
"""Difference from the paper, linear light, at which a pixel counts as fully painted."""


@dataclass(frozen=True)
class StrokeModel:
    """A base model, the mechanisms that extend it, and the correction of their mark."""

    parameters: Traj2StrokeParameters
    mechanisms: tuple[Mechanism, ...]
    fitted: Mapping[str, Span]
    """Range of every covariate that the mechanisms read."""
    timing: StrokeTiming
    correction: MarkCorrection | None = None

    def mark(self) -> Traj2Stroke:
        """The base, frozen."""
        return Traj2Stroke(self.parameters).requires_grad_(False)


def base_model(parameters: Traj2StrokeParameters) -> StrokeModel:
    """A model without mechanisms and correction."""
    return StrokeModel(parameters, (), {}, StrokeTiming(0.0, 0.0))


class MeasuredStrokes(NamedTuple):
    """Samples with the covariates that mechanisms may read."""

    samples: StrokeSamples
    covariates: dict[str, Tensor]
    """[B] each: columns of the strokes contract; NaN where unknown."""

    def pick(self, index: Tensor) -> MeasuredStrokes:
        """The strokes with these indices."""
        return MeasuredStrokes(self.samples.pick(index), {name: v[index] for name, v in self.covariates.items()})

    @property
    def context(self) -> StrokeContext:
        """The strokes as mechanisms see them, [B, 1, ...]."""
        columns = {name: values[:, None] for name, values in self.covariates.items()}
        return StrokeContext(self.samples.path[:, None], columns)


def predict_strokes(model: StrokeModel, strokes: MeasuredStrokes) -> Tensor:
    """The photograph after each stroke, sRGB [B, H, W, 3].

    Covariates beyond the range that the causes were fitted to are held at its end, as in a plan.
    """
    held = {name: values.clamp(*model.fitted[name].ends) if name in model.fitted else values
            for name, values in strokes.covariates.items()}  # fmt: skip
    with torch.no_grad():
        return predict_extended(model.mark(), model.mechanisms, strokes._replace(covariates=held), model.correction)


def predict_extended(
    mark: Traj2Stroke,
    mechanisms: Sequence[Mechanism],
    strokes: MeasuredStrokes,
    correction: Callable[[Mark, Tensor], Mark] | None = None,
) -> Tensor:
    """The photograph after each stroke, sRGB [B, H, W, 3]; differentiable in the values of all parts."""
    samples = strokes.samples
    canvas, color = samples.before_linear, srgb_to_linear(samples.color)[:, None]
    if picks_up(mechanisms, color, strokes.context):
        canvas = torch.cat([canvas, painted(canvas)[..., None]], dim=-1)
    image = simulate(
        mark, mechanisms, strokes.context, color=color, canvas=canvas, view=samples.view, correction=correction
    )
    return linear_to_srgb(image)


def picks_up(mechanisms: Sequence[Mechanism], color: Tensor, context: StrokeContext) -> bool:
    """Whether a mechanism picks up wet paint, so that the canvas needs its fourth channel, wetness."""
    with torch.no_grad():
        return any(mechanism.composite(color, None, context)[1] is not None for mechanism in mechanisms)


def painted(before_linear: Tensor) -> Tensor:
    """Paint on each pixel, 0 to 1, [B, H, W], by the difference from the colour of each window's paper."""
    paper = before_linear.flatten(1, 2).quantile(0.9, dim=1)[:, None, None]
    return ((before_linear - paper).abs().amax(-1) / _PAINTED).clamp(0.0, 1.0)


def columns_read(mechanisms: Sequence[Mechanism], strokes: MeasuredStrokes) -> list[str]:
    """The covariates that the mechanisms read, in alphabetical order."""
    few = strokes.pick(torch.arange(1))
    columns = _Read(few.context.covariates)
    context, color = few.context._replace(covariates=columns), torch.zeros(1, 1, 3)
    mark = base_model(_ANY).mark()(context.path)
    with torch.no_grad():
        for mechanism in mechanisms:
            mechanism.executed(context.path, context)
            mechanism.mark(mark, context)
            mechanism.composite(color, None, context)
    return sorted(columns.read)


def spans(names: Sequence[str], strokes: MeasuredStrokes) -> dict[str, Span]:
    """The range of each covariate over the strokes for which it is known."""
    found = {}
    for name in names:
        values = strokes.covariates[name]
        known = values[torch.isfinite(values)].double()
        found[name] = Span(float(known.min()), float(known.mean()), float(known.max()))
    return found


def timing_of(covariates: Mapping[str, Tensor]) -> StrokeTiming:
    """Medians from the recorded times of photographs and of strokes' starts; 0 where they were not recorded."""
    if not {"t_start_s", "t_before_s", "since_reload"} <= set(covariates):
        return StrokeTiming(0.0, 0.0)
    between, dipped = covariates["t_start_s"] - covariates["t_before_s"], covariates["since_reload"] == 0
    reach = _median(between[~dipped])
    return StrokeTiming(reach, max(_median(between[dipped]) - reach, 0.0) if reach else 0.0)


def _median(values: Tensor) -> float:
    known = values[torch.isfinite(values)]
    return float(known.median()) if len(known) else 0.0


@dataclass(frozen=True)
class _StoredQuantity:
    value: float
    unit: str


@dataclass(frozen=True)
class _StoredMechanism:
    cause: str
    values: dict[str, _StoredQuantity]
    reference: dict[str, float]


@dataclass(frozen=True)
class _StoredExtension:
    """Content of ``mechanisms.json``."""

    mechanisms: tuple[_StoredMechanism, ...]
    fitted: dict[str, Span]
    timing: StrokeTiming


def model_files(model: StrokeModel) -> dict[str, Any]:
    """Contents of a model's folder, by file name; ``parameters.json`` is that of Traj2Stroke alone."""
    mechanisms = tuple(
        _StoredMechanism(
            mechanism.cause,
            {
                quantity.name: _StoredQuantity(value, quantity.unit)
                for quantity, value in zip(mechanism.quantities, mechanism.values.tolist(), strict=True)
            },
            dict(mechanism.reference),
        )
        for mechanism in model.mechanisms
    )
    extension = _StoredExtension(mechanisms, dict(model.fitted), model.timing)
    return {
        "parameters.json": to_plain(model.parameters),
        "mechanisms.json": to_plain(extension),
        "correction.json": model.correction and to_plain(model.correction.parameters_si()),
    }


def read_stroke_model(folder: Path) -> StrokeModel:
    """Read what ``model_files`` gave.

    Raises:
        ContractError: a file is missing, or does not hold causes of the vocabulary with their quantities.
    """
    parameters, path = read_parameters(folder / "parameters.json"), folder / "mechanisms.json"
    try:
        stored = from_plain(_StoredExtension, json.loads(path.read_text(encoding="utf-8")), "the file")
        mechanisms = tuple(map(_mechanism, stored.mechanisms))
    except (OSError, ValueError, ContractError) as error:
        raise ContractError(
            f"{path} does not hold the mechanisms of a stroke model ({error}): make it with the stage diagnose_gap."
        ) from error
    correction = read_correction(folder / "correction.json")
    return StrokeModel(parameters, mechanisms, stored.fitted, stored.timing, correction)


def _mechanism(stored: _StoredMechanism) -> Mechanism:
    kinds = {kind.cause: kind for kind in VOCABULARY}
    if stored.cause not in kinds:
        raise ValueError(f"{stored.cause!r} is no cause of the vocabulary")
    kind = kinds[stored.cause]
    units = {quantity.name: quantity.unit for quantity in kind.quantities}
    found = {name: value.unit for name, value in stored.values.items()}
    if found != units:
        raise ValueError(f"the quantities of {kind.cause} are {units}, by name and unit, not {found}")
    values = [stored.values[name].value for name in units]
    return kind(torch.tensor(values), stored.reference)


class _Read(Mapping[str, Tensor]):
    """Covariates that record which of them were read."""

    def __init__(self, columns: Mapping[str, Tensor]) -> None:
        self._columns, self.read = columns, set[str]()

    def __getitem__(self, name: str) -> Tensor:
        self.read.add(name)
        return self._columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)


_ANY = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 1e-3, 0.3, 0.9)
