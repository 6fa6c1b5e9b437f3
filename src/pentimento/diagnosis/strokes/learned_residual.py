"""What a tool does alike in every stroke and no base of a few numbers foretells: tufts, ragged ends, a paler side.

Boosted trees learn it, pixel by pixel, from where a pixel lies about its place of the path, the press there and how it
changes, how far it is to the stroke's ends, and how a tool that is turned lies to its way: nothing else that a cause
depends on (no speed, time, load, heading on the canvas, bend, length, place). Two things keep them from learning an
effect instead (docs/diagnosis.md §4). What they say of a stroke was learnt from others (cross-fitting; Chernozhukov et
al. 2018), and what of it looks, over all strokes and beyond chance, like any of the causes is left in the residual, so
that this cause's score does not change: only the misfit about it falls. They learn twice: where each stroke as a whole
came to lie and how wide is chance, hides what is alike, and is known better once that has been learnt. Of a tool that
draws its left as it draws its right, which the first trees tell, they then see one half, twice as often. Sealed
strokes have no part in any of it, and are told in the end by trees that learn from all others at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.diagnosis.boosting import Trees, action_effect, cross_fitted, folds, grown, like_causes, said_at
from pentimento.diagnosis.strokes.fit import steadied
from pentimento.diagnosis.strokes.jacobian import change_of_photographs, linearise, slope_by_coverage
from pentimento.diagnosis.strokes.measured import Measured
from pentimento.diagnosis.strokes.model import Model
from pentimento.diagnosis.strokes.predict import ink_of, mark_px, predicted, press_shares, residual
from pentimento.diagnosis.strokes.soft_edge import Imprint
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

_FAINTEST = 0.03  # squared slope of sRGB by coverage at which coverage cannot be seen
_FARTHEST = 3.0  # half-widths from an end: beyond, a stroke's body is the same everywhere
_STEADIED = 0.001
"""Of what holds a fit: too little to leave in the photographs what the base would do, enough where nothing was seen."""
_TURNED_RAD = 0.2
"""Standard deviation of a tool's yaw from which its bundle is seen from several sides."""
_TREES = 50
_FIRST_TREES = 20  # enough to see by how much each stroke is displaced
_LEFT, _SINE = 0, 8
"""Features that change their sign in the mirror."""


@dataclass(frozen=True)
class LearnedResidual:
    """What was learnt, as seen from a model."""

    model: Model
    trees: tuple[Trees, ...]
    share: float
    """By how much what the trees say is to be believed, 0 to 1."""
    like_causes: Array
    """[P] of the model's numbers: what of it they would do."""
    turned: bool
    """Whether they know how the tool lies to its way."""
    mirrored: bool
    """Whether left and right are one to them."""

    def seen_from(self, model: Model) -> LearnedResidual:
        """The same, seen from a model that knows more paints: what is like causes does nothing to those."""
        new = model.nuisances - self.model.nuisances
        return replace(self, model=model, like_causes=np.insert(self.like_causes, [self.model.nuisances] * new, 0.0))

    def of(self, measured: Measured) -> Measured:
        """Strokes that nothing was learnt from, with their habits."""
        pixels = _Pixels(self.model, measured, self.turned)
        return self._joined(measured, pixels, self._say(pixels))

    def learnt_from_all(self, measured: Measured, rows: Array) -> tuple[LearnedResidual, Measured]:
        """Habits learnt once more, from all strokes with the indices ``rows`` by one set of trees, which knows more
        than sets that each learn from a part; and the strokes, of which those that are none of ``rows`` have these.

        Args:
            measured: strokes that have these habits.
        """
        bare = replace(measured, habit=np.zeros_like(measured.habit))
        pixels = _Pixels(self.model, bare, self.turned)
        left = pixels.along_slope(residual(self.model, measured))
        missing = pixels.along_slope(residual(self.model, bare))
        missing -= action_effect(left, pixels.by_place_and_width, pixels.depth, pixels.stroke)
        trees = grown(self._told_of(pixels), missing, pixels.depth, np.isin(pixels.stroke, rows), _TREES)
        learned_residual = replace(self, trees=(trees,))
        habit = learned_residual._joined(bare, pixels, learned_residual._say(pixels)).habit
        habit[rows] = measured.habit[rows]
        return learned_residual, replace(measured, habit=habit)

    def _told_of(self, pixels: _Pixels) -> Array:
        return one_sided(pixels.features) if self.mirrored else pixels.features

    def _say(self, pixels: _Pixels) -> Array:
        features = self._told_of(pixels)
        return np.asarray(np.mean([trees.say(features) for trees in self.trees], axis=0))

    def _joined(self, measured: Measured, pixels: _Pixels, said: Array) -> Measured:
        habit = self.share * pixels.photographs(said)
        return replace(measured, habit=habit - change_of_photographs(self.model, measured, self.like_causes))


def learn_residual(
    measured: Measured, model: Model, rows: Array, candidates: Sequence[Mechanism], seed: int
) -> tuple[LearnedResidual, Measured]:
    """Habits of the strokes with the indices ``rows``, and all strokes with theirs instead of any that they had.

    Args:
        model: fitted to them.
        candidates: causes beside the model's whose effects must stay in the residual.
    """
    measured = replace(measured, habit=np.zeros_like(measured.habit))
    # Of one that is never turned, that would be the way on the canvas, which causes depend on.
    turned = bool(measured.samples.path[rows, 0, 4].std() > _TURNED_RAD)
    pixels = _Pixels(model, measured, turned)
    missing = pixels.along_slope(residual(model, measured))
    features, fold = pixels.features, folds(measured.action, rows, seed)[pixels.stroke]
    trees, said, share = cross_fitted(features, missing, pixels.depth, fold, _FIRST_TREES)
    both = (said + said_at(trees, in_the_mirror(features), fold)) / 2
    learnt = fold >= 0
    mirrored = bool((pixels.depth * (np.square(missing - both) - np.square(missing - said)))[learnt].sum() < 0)
    # Where a stroke as a whole came to lie, and how wide, is chance, and much of the noise. It shows once what is alike
    # is taken away.
    missing -= action_effect(missing - share * said, pixels.by_place_and_width, pixels.depth, pixels.stroke)
    features = one_sided(features) if mirrored else features
    trees, said, share = cross_fitted(features, missing, pixels.depth, fold, _TREES)
    full = model.plus(*candidates)
    amounts = _fitted(share * pixels.photographs(said), measured, full, rows)
    unlike = [m.cause for m in candidates if not amounts[full.columns_of(m.cause)].any()]
    columns = [full.columns_of(cause) for cause in unlike]
    amounts = np.delete(amounts, np.concatenate(columns) if columns else [])
    learned_residual = LearnedResidual(full.without(*unlike), trees, share, amounts, turned, mirrored)
    return learned_residual, learned_residual._joined(measured, pixels, said)


class _Pixels:
    """Pixels of strokes where coverage can be seen."""

    def __init__(self, model: Model, measured: Measured, turned: bool) -> None:
        mark = mark_px(model, measured)
        laid = ink_of(mark, model, measured)
        self._towards = slope_by_coverage(laid, measured)
        depth = np.square(self._towards).sum(-1)
        self._seen = (laid.imprint.segment >= 0) & (depth > _FAINTEST)
        self.depth = depth[self._seen]
        """How clearly coverage shows, [n]."""
        self.stroke = np.nonzero(self._seen)[0]
        """Index of each one's stroke, [n]."""
        self.by_place_and_width = laid.imprint.by_mark[self._seen][:, :3].astype(float)
        """How coverage changes as the mark there moves, two ways, and widens, [n, 3]."""
        lie = _lie(mark, measured.samples.path[..., 4].double().numpy()) if turned else []
        self.features = _features(laid.imprint, self._seen, mark, press_shares(model, measured), lie)

    def along_slope(self, photographs: Array) -> Array:
        """The coverage [n] that photographs [B, H, W, 3] amount to."""
        return np.asarray((photographs * self._towards).sum(-1)[self._seen] / self.depth)

    def photographs(self, coverage: Array) -> Array:
        """What coverage [n] does to the photographs, float32[B, H, W, 3]."""
        change = np.zeros_like(self._towards)
        change[self._seen] = coverage[:, None] * self._towards[self._seen]
        return change


def in_the_mirror(features: Array) -> Array:
    """Those of ``_features`` of what lies on the other side of the way, in a mirror along it."""
    mirrored = features.copy()
    mirrored[:, [_LEFT, *range(_SINE, features.shape[1])]] *= -1
    return mirrored


def one_sided(features: Array) -> Array:
    """The same of what lies on the left, and in the mirror of what lies on the right."""
    return np.where(features[:, [_LEFT]] < 0, in_the_mirror(features), features)


def _lie(mark: Array, yaw: Array) -> list[Array]:
    """How the tool lies to its way, [B, N] each: cosine and sine of twice the angle, a half turn being none."""
    step = np.gradient(mark[..., :2], axis=1)
    twice = 2 * (np.arctan2(-step[..., 1], step[..., 0]) - yaw)
    return [np.cos(twice), np.sin(twice)]


def _features(made: Imprint, seen: Array, mark: Array, press: Array, lie: Sequence[Array]) -> Array:
    """[n, 7 and one for each of ``lie``]: how far left and ahead of its place on the path a pixel lies, its coverage;
    press there, and its slope; how far it is to the start and to the end; how the tool lies there. Lengths in
    half-widths.
    """
    stroke, k, t = np.nonzero(seen)[0], made.segment[seen].astype(int), made.along[seen]
    half = np.maximum(mark[..., 2], 1e-3)
    step = np.linalg.norm(np.diff(mark[..., :2], axis=1), axis=-1)
    arc = np.concatenate([np.zeros((len(step), 1)), np.cumsum(step, axis=1)], axis=1)
    slope = np.gradient(press, axis=1) / np.maximum(np.gradient(arc, axis=1), 1e-6) * half
    following = np.minimum(k + 1, arc.shape[1] - 1)

    def there(values: Array) -> Array:
        return np.asarray(values[stroke, k] * (1 - t) + values[stroke, following] * t)

    here, width = there(arc), there(half)
    ends = [np.minimum(far / width, _FARTHEST) for far in (here, arc[stroke, -1] - here)]
    turns = [there(values) for values in lie]
    return np.stack([*made.place[seen].T, made.coverage[seen], there(press), there(slope), *ends, *turns], axis=1)


def _fitted(photographs: Array, measured: Measured, model: Model, rows: Array) -> Array:
    """Changes [P] of the model's numbers that would do to the strokes ``rows`` what comes nearest to photographs
    [B, H, W, 3]; 0 of those quantities of mechanisms that come to no more than chance.
    """
    after = torch.from_numpy((predicted(model, measured) + photographs).astype(np.float32))
    asked = replace(measured, samples=measured.samples._replace(after=after)).pick(rows)
    # What strokes leave open would be anything, and an absurdity on one that was not looked at.
    return like_causes(steadied(linearise(model, asked), model, _STEADIED), model.nuisances)
