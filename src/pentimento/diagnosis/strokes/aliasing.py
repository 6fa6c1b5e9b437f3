"""Which causes a set of strokes can tell apart: the imitation matrix (GAP.md, rule 8).

Two causes imitate each other where their derivatives, less what the nuisances can take up, point the same way in the
space of all photographs. That is a property of the strokes' design: it takes commands and a model, and no photograph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.frames import image_shape, window_around
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import IMAGE, vector
from pentimento.diagnosis.strokes.jacobian import Statistics, linearise
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.predict import Model, identity
from pentimento.dynamics.strokes.simulation import Mechanism, NotObservable

Array = NDArray[Any]

ALIKE = 0.9
"""Above it, strokes can hardly tell two causes apart."""
_RIDGE = 1e-9
_UNSEEN = 1e-6
"""Of a cause's information: what must be left of it when the nuisances have taken their part."""
_PAPER = 237
_LONGER_SIDE_PX = 64
_MARGIN_M = 0.012


class Aliasing(NamedTuple):
    """Of C causes."""

    causes: tuple[str, ...]
    cosine: Array
    """[C, C], 0 to 1: |cosine| of the two derivatives without the nuisances' part; for causes of more quantities the
    largest canonical correlation. NaN where the nuisances leave nothing of a cause."""

    def of(self, first: str, second: str) -> float:
        """One entry, by the causes' names."""
        return float(self.cosine[self.causes.index(first), self.causes.index(second)])

    @property
    def largest(self) -> float:
        """Of all pairs; 0 where there is none to compare."""
        pairs = self.cosine[np.tril_indices(len(self.causes), -1)]
        return float(np.max(pairs[np.isfinite(pairs)], initial=0.0))


class Columns(NamedTuple):
    """Where a model's Jacobian lists what."""

    nuisances: Array
    causes: dict[str, Array]


def columns_of(model: Model) -> Columns:
    """Indices into the Jacobian of ``model``: nuisances, and the quantities of each of its mechanisms."""
    causes, at = {}, model.nuisances
    for mechanism in model.mechanisms:
        causes[mechanism.cause] = np.arange(at, at + len(mechanism.quantities))
        at += len(mechanism.quantities)
    return Columns(np.arange(model.nuisances), causes)


def with_all(model: Model, measured: Measured, vocabulary: Sequence[type[Mechanism]]) -> Model:
    """The model with every cause that these strokes can show and that it has not yet, at no effect."""
    there = {mechanism.cause for mechanism in model.mechanisms}
    more = []
    for kind in vocabulary:
        if kind.cause in there:
            continue
        try:
            more.append(identity(kind, measured.context))
        except NotObservable:
            continue
    return model.plus(*more)


def information(curvature: Array, nuisances: Array, interest: Array) -> Array:
    """What strokes say of some numbers when the nuisances are free: the Schur complement, [Q, Q].

    Args:
        curvature: [P, P], summed over actions.
        nuisances: their indices.
        interest: indices of the Q numbers.
    """
    held = curvature[np.ix_(nuisances, nuisances)]
    held = held + np.diag(_RIDGE * np.diag(held) + 1e-15)
    cross = curvature[np.ix_(nuisances, interest)]
    left: Array = curvature[np.ix_(interest, interest)] - cross.T @ np.linalg.solve(held, cross)
    return (left + left.T) / 2


def aliasing(statistics: Statistics, columns: Columns) -> Aliasing:
    """The imitation matrix from statistics at a model."""
    names = tuple(columns.causes)
    index = np.concatenate([columns.causes[name] for name in names]) if names else np.zeros(0, int)
    total = statistics.curvature.sum(0)
    left = information(total, columns.nuisances, index)
    own = total[index, index]
    at = np.cumsum([0, *(len(columns.causes[name]) for name in names)])
    parts = [slice(first, last) for first, last in pairwise(at)]
    whitening = [_whitening(left[part, part], own[part]) for part in parts]
    cosine = np.eye(len(names))
    for i, of_i in enumerate(whitening):
        if of_i.shape[1] == 0:
            cosine[i] = cosine[:, i] = np.nan
    for i in range(len(names)):
        for j in range(i):
            if np.isfinite(cosine[i, j]):
                shared = whitening[i].T @ left[parts[i], parts[j]] @ whitening[j]
                cosine[i, j] = cosine[j, i] = min(float(np.linalg.norm(shared, 2)), 1.0)
    return Aliasing(names, cosine)


def aliasing_of(model: Model, measured: Measured, vocabulary: Sequence[type[Mechanism]]) -> Aliasing:
    """Between all causes that these strokes can show, at a model."""
    full = with_all(model, measured, vocabulary)
    return aliasing(linearise(full, measured), columns_of(full))


def sentences(found: Aliasing, alike: float = ALIKE) -> list[str]:
    """A sentence for each pair that can hardly be told apart, the closest first, and for each cause not seen at all."""
    said = [
        f"{first} and {second} imitate each other ({value:.2f}): this table can hardly tell them apart."
        for value, first, second in _closest(found, alike)
    ]
    return said + [f"{cause} leaves no trace in this table that the base could not leave." for cause in _unseen(found)]


def in_short(found: Aliasing, alike: float = ALIKE) -> str:
    """The same in one line, such as "tool_wear ~ drying_shift .97"; the closest pair where none is that close."""
    closest = _closest(found, alike)
    said = [f"{first} ~ {second} {value:.2f}".replace(" 0.", " .") for value, first, second in closest]
    if not said:
        nearest = [f"{first} ~ {second} {v:.2f}".replace(" 0.", " .") for v, first, second in _closest(found, 0.0)[:1]]
        said = [f"no two causes above {alike:.2f}".replace(" 0.", " .") + "".join(f" ({pair})" for pair in nearest)]
    return ", ".join(said + [f"no trace of {cause}" for cause in _unseen(found)])


def _closest(found: Aliasing, alike: float) -> list[tuple[float, str, str]]:
    """Pairs above a value, the closest first."""
    rows, cols = np.tril_indices(len(found.causes), -1)
    pairs = sorted(
        ((float(found.cosine[i, j]), i, j) for i, j in zip(rows, cols, strict=True) if found.cosine[i, j] > alike),
        reverse=True,
    )
    return [(value, found.causes[j], found.causes[i]) for value, i, j in pairs]


def _unseen(found: Aliasing) -> list[str]:
    return [cause for cause, own in zip(found.causes, np.diag(found.cosine), strict=True) if np.isnan(own)]


def design(commands: pa.Table) -> Measured:
    """Strokes that have not been made yet, so that the imitation matrix can be known before any is.

    ``commands`` is a table of the strokes contract; of its required columns, ``window_m``, ``before`` and ``after`` may
    be absent. Photographs that are not there are blank paper, so that what depends on paint below (``wet_mixing``)
    shows only where ``before`` is given.

    Raises:
        ContractError: the table has no rows, or a row (it is named) makes no sample.
    """
    rows = commands.to_pylist()
    windows = [row.get("window_m") or window_around(np.array(row["path"]), _MARGIN_M).tolist() for row in rows]
    before = [row.get("before") or _paper(window) for row, window in zip(rows, windows, strict=True)]
    given = commands.select([n for n in commands.schema.names if n not in ("window_m", "before", "after")])
    images = pa.array(before, IMAGE)
    for name, values in (("window_m", pa.array(windows, vector(4))), ("before", images), ("after", images)):
        given = given.append_column(name, values)
    return load_measured(given)


def _paper(window_m: Sequence[float]) -> dict[str, Any]:
    longer = max(window_m[2] - window_m[0], window_m[3] - window_m[1])
    shape = image_shape(window_m, _LONGER_SIDE_PX / longer)
    return {"bytes": encode_png(np.full((*shape, 3), _PAPER, np.uint8)), "path": None}


def _whitening(left: Array, own: Array) -> Array:
    """[Q, rank] with  W^T left W = 1, without directions that the nuisances take up."""
    scale = np.sqrt(np.maximum(own, 1e-300))
    values, vectors = np.linalg.eigh(left / np.outer(scale, scale))
    seen = values > _UNSEEN
    whitening: Array = vectors[:, seen] / np.sqrt(values[seen]) / scale[:, None]
    return whitening


def pairs_alike(found: Aliasing, causes: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Each named cause with its rivals and with what imitates it, as pairs without repeats.

    Args:
        causes: the rivals of each named cause.
    """
    pairs: list[tuple[str, str]] = []
    for cause, rivals in causes.items():
        alike = [other for other in found.causes if other != cause and found.of(cause, other) > ALIKE]
        for other in dict.fromkeys([*rivals, *alike]):
            if (other, cause) not in pairs:
                pairs.append((cause, other))
    return pairs
