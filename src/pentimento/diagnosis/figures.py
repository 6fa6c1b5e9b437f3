"""Figures of a diagnosis that strokes and pushes share, as PNG bytes; equal data give equal bytes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pentimento.diagnosis.diagnose import Result
from pentimento.diagnosis.experiment_design import ALIASED, Aliasing, Columns, aliasing, detectable
from pentimento.diagnosis.gauss_newton import Statistics
from pentimento.diagnosis.problem import M
from pentimento.diagnosis.residual_structure import (
    Dependence,
    dependences,
    mode_strength,
    robust_deviations,
)
from pentimento.diagnosis.temporal_drift import TemporalDrift
from pentimento.report.figures import BLUE, INK, OCHRE, drawing, png

Array = NDArray[Any]

DIVERGING = "RdBu_r"
QUIET = "#8a8a86"
GREEN = "#4f7f4a"
RED = "#a33a3a"
_PAGE_IN = 10.5
"""Width of a page-wide figure."""
_MIN_BAR = 0.002
"""Smallest drawn generic gain, as a share of the base's error."""
_MIN_TOP = 4.0
"""Smallest end of the colour scale: chance correlations reach it."""
_NEIGHBOURS = 7
"""Rows of a running mean."""


RowsT = TypeVar("RowsT")
ModelT = TypeVar("ModelT")


@dataclass(frozen=True)
class Screening(Generic[RowsT, ModelT]):
    """What the report shows beside the verdict, of B rows, M residual modes and C covariates."""

    measured: RowsT
    test: RowsT
    """The test split."""
    full: ModelT
    """The extended model with every other observable cause at 0."""
    aliasing: Aliasing
    detectable: dict[str, float]
    """Smallest fraction of the error that each cause must remove to be detected with a power of 80 % at this size."""
    base_strength: Array
    """[M, C] sqrt(n) |r| of the base's residual."""
    extended_strength: Array
    """[M, C] of the extended model's."""
    covariates: tuple[str, ...]
    modes: tuple[str, ...]
    dependence: tuple[Dependence, ...]
    """The strongest pairs."""
    base_residual: Array
    """[B, H, W] measured minus predicted; NaN where nothing was measured."""
    extended_residual: Array


def screening_of(
    measured: RowsT,
    test: RowsT,
    full: ModelT,
    statistics: Statistics,
    columns: Columns,
    *,
    modes: Sequence[str],
    scores: tuple[Array, Array],
    covariates: dict[str, Array],
    residuals: tuple[Array, Array],
    action: Array,
) -> Screening[RowsT, ModelT]:
    """The screening of a diagnosis.

    Args:
        measured: all rows.
        test: rows of the test split.
        full: the extended model with every other observable cause at 0.
        statistics: of ``full`` on all rows.
        columns: of ``full``.
        modes: names, [M].
        scores: amounts of the modes [B, M] in the residual of base and extended model.
        covariates: [B] each.
        residuals: [B, H, W] of base and extended model.
        action: rows of equal value repeat one command, [B].
    """
    base, extended = (robust_deviations(amounts) for amounts in scores)
    strengths = {"base": mode_strength(base, covariates), "extended": mode_strength(extended, covariates)}
    return Screening(
        measured,
        test,
        full,
        aliasing(statistics, columns),
        detectable(statistics, columns),
        strengths["base"],
        strengths["extended"],
        tuple(covariates),
        tuple(modes),
        dependences(modes, base, extended, covariates=covariates, strengths=strengths, action=action),
        *residuals,
    )


class ResidualMap(NamedTuple):
    """Mean and worst residual at each place; NaN where nothing was measured."""

    mean: Array
    """[H, W]"""
    worst: Array
    """[H, W] the residual of largest magnitude."""
    extent: tuple[float, float, float, float]
    """left, right, bottom, top."""


def residual_maps(
    base: ResidualMap, extended: ResidualMap, x_label: str, *, y_label: str, square: bool, unit: str = "sRGB"
) -> bytes:
    """Mean and worst residual of both models; a symmetric scale for the means and one for the worst."""
    tall = base.mean.shape[0] / base.mean.shape[1] if square else 0.5
    with drawing():
        figure = Figure(figsize=(11.5, 2 * 4.6 * tall + 0.9), layout="constrained")
        cells = figure.subplots(2, 2, sharex=True, sharey=True)
        models = ("base", "extended")
        columns = {"mean": [base.mean, extended.mean], "worst": [base.worst, extended.worst]}
        for column, (name, images) in enumerate(columns.items()):
            top = _symmetric(images)
            for row, (axes, image, model) in enumerate(zip(cells[:, column], images, models, strict=True)):
                shown = axes.imshow(
                    image, cmap=DIVERGING, vmin=-top, vmax=top, extent=base.extent, interpolation="nearest",
                    aspect="equal" if square else "auto",
                )  # fmt: skip
                axes.set_title(f"{model}, {name}")
                axes.set_facecolor("#efefea")
                axes.tick_params(length=2)
                if row == 1:
                    axes.set_xlabel(x_label)
                if column == 0:
                    axes.set_ylabel(y_label)
                if not square:
                    for end in (0, 1):
                        axes.axvline(end, color=INK, lw=0.7, ls=":")
            figure.colorbar(shown, ax=list(cells[:, column]), label=f"measured − predicted, {unit}", shrink=0.8)
        return png(figure)


def mode_heat(screening: Screening[Any, Any], structured: set[tuple[str, str]]) -> bytes:
    """Strength of each residual mode's correlation with each covariate, for base and extended model."""
    with drawing():
        figure = Figure(figsize=(max(2.6 + 0.52 * len(screening.covariates), _PAGE_IN), 6.4), layout="constrained")
        cells = figure.subplots(2, 1, sharex=True)
        strengths = (screening.base_strength, screening.extended_strength)
        top = max(float(np.max(strengths, initial=0.0)), _MIN_TOP)
        for axes, name, strength in zip(cells, ("base", "extended"), strengths, strict=True):
            image = axes.imshow(strength, cmap="viridis", vmin=0, vmax=top, aspect="auto")
            axes.set_yticks(range(len(screening.modes)), screening.modes)
            axes.set_title(f"{name} model")
            _numbers(axes, strength, "{:.0f}", 0.6 * top)
            axes.tick_params(length=0)
            if name == "extended":
                for mode, covariate in structured:
                    if covariate in screening.covariates:
                        at = screening.covariates.index(covariate), screening.modes.index(mode)
                        axes.plot(*at, "s", ms=19, mfc="none", mec="#ff5a36", mew=2)
        cells[1].set_xticks(range(len(screening.covariates)), screening.covariates, rotation=55, ha="right")
        figure.colorbar(image, ax=list(cells), label="√n |correlation|", shrink=0.7)
        return png(figure)


def dependence(screening: Screening[Any, Any]) -> bytes:
    """Residual modes over covariates: means of bins with their 95 % bands, base and extended model."""
    shown = screening.dependence
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    with drawing():
        figure = Figure(figsize=(11.5, 2.7 * rows + 0.4), layout="constrained")
        cells = figure.subplots(rows, columns, squeeze=False)
        for axes in cells.flat[len(shown) :]:
            axes.set_visible(False)
        for axes, one in zip(cells.flat, shown, strict=False):
            axes.axhline(0, color=QUIET, lw=0.8)
            curves = [("base", one.base, OCHRE), ("extended", one.extended, BLUE)]
            if np.array_equal(one.base, one.extended):  # no cause was added
                curves.pop()
            for name, values, colour in curves:
                mean, band = values.T
                axes.plot(one.centre, mean, "-o", color=colour, ms=3.5, lw=1.8, label=name)
                axes.fill_between(one.centre, mean - band, mean + band, color=to_rgba(colour, 0.18), lw=0)
            axes.set_xlabel(one.covariate)
            axes.set_title(one.mode)
        for axes in cells[:, 0]:
            axes.set_ylabel("residual, deviations")
        cells[0, 0].legend(loc="best", fontsize=9)
        return png(figure)


def drift_curve(drift: TemporalDrift) -> bytes:
    """The drifting mode, row by row in the order of execution, and its running mean."""
    amount = drift.amount
    window = np.ones(_NEIGHBOURS)
    mean = np.convolve(amount, window, "same") / np.convolve(np.ones_like(amount), window, "same")
    with drawing():
        figure = Figure(figsize=(9.0, 3.4), layout="constrained")
        axes = figure.add_subplot()
        axes.axhline(0.0, color="#deded8", lw=1.0, zorder=1)
        axes.plot(amount, "o", color=QUIET, ms=3.5, zorder=2)
        axes.plot(mean, color=OCHRE, lw=2.0, zorder=3)
        axes.set(xlabel="order of execution", ylabel=drift.mode, xlim=(-1, len(amount)))
        return png(figure)


def aliasing_heat(found: Aliasing, named: Sequence[str]) -> bytes:
    """The aliasing matrix; established and suspected causes are bold."""
    count = max(len(found.causes), 2)
    with drawing():
        figure = Figure(figsize=(max(2.9 + 0.48 * count, _PAGE_IN), 1.9 + 0.44 * count), layout="constrained")
        axes = figure.add_subplot()
        lower = np.where(np.tri(len(found.causes), k=-1, dtype=bool), found.cosine, np.nan)
        image = axes.imshow(lower, cmap="magma_r", vmin=0, vmax=1)
        axes.set_facecolor("#f7f7f4")
        _numbers(axes, lower, "{:.2f}", 0.5)
        axes.set_yticks(range(len(found.causes)), found.causes)
        axes.set_xticks(range(len(found.causes)), found.causes, rotation=55, ha="right")
        for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
            if label.get_text() in named:
                label.set_fontweight("bold")
        axes.tick_params(length=0)
        for i, j in np.argwhere(lower > ALIASED):
            axes.plot(j, i, "s", ms=20, mfc="none", mec=BLUE, mew=2)
        figure.colorbar(image, ax=axes, label="|cosine|", shrink=0.7)
        return png(figure)


def leave_one_out(result: Result[M], given_mse: float | None = None) -> bytes:
    """Errors on the test split: a given model, the base, the extended model without each cause and with all, the floor.

    The effects of causes do not add up: of two that displace a mark, one alone may do as well, or neither.
    """
    base, extended = float(result.base_losses.mean()), float(result.extended_losses.mean())
    floor = result.floor
    with drawing():
        bars: list[tuple[str, float, float, str, bool]] = [("base", 0.0, base, OCHRE, False)]
        if given_mse is not None:
            bars.insert(0, ("given\nmodel", 0.0, given_mse, INK, False))
        for finding in result.established:
            low, high = sorted((extended, finding.mse_without))
            colour = GREEN if finding.mse_without >= extended else RED
            bars.append((f"without\n{finding.cause}", low, high, colour, False))
        bars.append(("extended", 0.0, extended, BLUE, False))
        left = max(result.structure.unexplained, key=lambda one: one.generic_gain, default=None)
        if left is not None and left.generic_gain * extended > _MIN_BAR * base:
            generic = f"− generic:\n{left.mode} by\n{left.covariate}"
            bars.append((generic, extended * (1 - left.generic_gain), extended, QUIET, True))
        if floor is not None:
            bars.append(("noise floor", 0.0, floor.mse, "#bdbdb6", False))
        figure = Figure(figsize=(max(1.5 * len(bars) + 1.2, 9.5), 3.6), layout="constrained")
        axes = figure.add_subplot()
        for x, (_, low, high, colour, expected) in enumerate(bars):
            axes.bar(
                x, high - low, bottom=low, width=0.62, color=to_rgba(colour, 0.35 if expected else 1.0),
                edgecolor=colour, hatch="//" if expected else None,
            )  # fmt: skip
            sign = "" if low == 0 else "+" if low == extended else "−"  # the change of the extended model's error
            axes.annotate(sign + _small(high - low), (x, high), (0, 3), textcoords="offset points", ha="center")
        if floor is not None:
            axes.axhspan(*floor.interval, color="#bdbdb6", alpha=0.4, lw=0)
        axes.set_xticks(range(len(bars)), [name for name, *_ in bars])
        axes.set_ylabel(f"mean squared error, {result.known.unit}")
        axes.margins(y=0.12)
        axes.ticklabel_format(axis="y", style="sci", scilimits=(-3, 3))
        return png(figure)


def _numbers(axes: Axes, values: Array, form: str, dark_from: float) -> None:
    for (i, j), value in np.ndenumerate(values):
        if np.isfinite(value):
            viridis = form == "{:.0f}"
            light = value < dark_from if viridis else value > dark_from
            axes.text(j, i, form.format(value), ha="center", va="center", fontsize=7.5, color="white" if light else INK)


def _symmetric(images: Sequence[Array]) -> float:
    values = np.abs(np.concatenate([image[np.isfinite(image)].ravel() for image in images]))
    return max(float(np.quantile(values, 0.995)), 1e-4)


def _small(value: float) -> str:
    return f"{value:.2g}" if value >= 1e-3 else f"{value:.1e}"
