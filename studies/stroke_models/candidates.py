"""The models that are compared, each trained on the same strokes: what it predicts, and how long that takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow as pa
import torch
from torch import Tensor

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.strokes.measured import covariates_of, load_measured
from pentimento.diagnosis.strokes.problem import established_mechanisms, stroke_problem
from pentimento.dynamics.strokes.evaluation import blank, fit_polyline, mean_iou, predict_with, weighted_l1
from pentimento.dynamics.strokes.extended import (
    MeasuredStrokes,
    StrokeModel,
    base_model,
    predict_strokes,
    timing_of,
)
from pentimento.dynamics.strokes.fit_correction import fit_correction
from pentimento.dynamics.strokes.joint import fit_jointly
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.paint_pickup import paint_pickup
from pentimento.dynamics.strokes.samples import StrokeSamples, load_samples
from pentimento.dynamics.strokes.training import TrainingConfig, train
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke
from studies.stroke_models.as_commanded import is_pressed, train_unscaled
from studies.stroke_models.networks.coverage import laid
from studies.stroke_models.networks.fit import (
    Setting,
    fit_param2stroke,
    fit_path_image_cnn,
    fit_refined,
    fit_trajectory_cnn,
    predicted,
)
from studies.stroke_models.networks.stamp import fit_stamp

Predict = Callable[[MeasuredStrokes], Tensor]

ANALYTIC = TrainingConfig(
    path_points=32, pixels_per_m=1000.0, margin_m=0.012, epochs=25, batch=16, learning_rate=0.03, ink_weight=2.0,
    held_out=0.25, seed=0,
)  # fmt: skip
"""Of Traj2Stroke, and of it with mechanisms: as the pipeline's, at 1 px/mm."""
STEPS, STEPS_OF_NUMBERS = 400, 800
"""In batches of 8: of a U-Net, and of a network that draws from numbers; small sets are seen more often."""
NETWORK = replace(ANALYTIC, epochs=1, batch=8, learning_rate=0.003, held_out=0.15)
DIAGNOSED = 120
"""Strokes that the diagnosis gets at most."""

NAMES = {
    "blank": "blank paper",
    "stamp": "stamp",
    "polyline": "constant-width polyline",
    "param2stroke": "param2stroke",
    "cnn": "CNN",
    "coordconv": "CNN with CoordConv",
    "path_image": "U-Net on the path's image",
    "traj2stroke": "Traj2Stroke",
    "refined": "Traj2Stroke + U-Net",
    "mechanisms": "Traj2Stroke + mechanisms",
    "corrected": "Traj2Stroke + mechanisms + correction",
}
TRIVIAL = ("blank", "stamp", "polyline")
_BASE, _EXTENDED = ("traj2stroke",), ("mechanisms", "traj2stroke")
BUILDS_ON = {"traj2stroke": _BASE, "refined": _BASE, "mechanisms": _EXTENDED, "corrected": _EXTENDED}
"""Models that are trained once, of which a model is one or builds on one: on the first that is there."""
NETWORKS = ("param2stroke", "cnn", "coordconv")
"""Of the thesis; ``path_image`` is not."""


@dataclass(frozen=True)
class Trained:
    """A model as it came out of training."""

    predict: Predict
    """The photographs after strokes, sRGB [B, H, W, 3]."""
    predict_for_iou: Predict
    """The same, but for trivial models: those fitted for the IoU."""
    said: Mapping[str, Any]
    """What else there is to say of it."""


def load_strokes(table: pa.Table, config: TrainingConfig = ANALYTIC) -> MeasuredStrokes:
    """Samples with all that mechanisms may read, at the resolution of ``config``."""
    samples = load_samples(table, config.path_points, config.pixels_per_m, config.margin_m)
    known = covariates_of(table) | paint_pickup(table, samples)
    return MeasuredStrokes(samples, {name: torch.tensor(v, dtype=torch.float32) for name, v in known.items()})


class Training:
    """The strokes that all models learn from; models that build on others find them here."""

    def __init__(self, table: pa.Table, asked_path: Tensor, config: TrainingConfig) -> None:
        """``asked_path`` [B, N, 5]: the commands on which models will be asked."""
        self.table, self.strokes, self.seed = table, load_strokes(table, config), config.seed
        self.samples = self.strokes.samples
        self.analytic = config
        self.setting, self.longer = (self._setting(asked_path, steps) for steps in (STEPS, STEPS_OF_NUMBERS))
        self._base: Traj2Stroke | None = None
        self._extended: tuple[StrokeModel, dict[str, Any]] | None = None
        self._before: dict[str, float] = {}
        """CPU seconds of models that others build on, by their names."""

    def fit(self, name: str) -> tuple[Trained, float]:
        """The model ``name``, and the CPU seconds that its training took, models that it builds on included."""
        started = time.process_time()
        before = next((self._before[each] for each in BUILDS_ON.get(name, ()) if each in self._before), 0.0)
        match name:
            case "blank":
                trained = _of(lambda strokes: blank(strokes.samples))
            case "stamp":
                trained = self._stamp()
            case "polyline":
                trained = self._polyline()
            case "param2stroke":
                trained = _network(fit_param2stroke(self.samples, self.longer, _quiet))
            case "cnn" | "coordconv":
                trained = _network(fit_trajectory_cnn(self.samples, self.longer, name == "coordconv", _quiet))
            case "path_image":
                trained = _network(fit_path_image_cnn(self.samples, self.setting, _quiet))
            case "traj2stroke":
                parameters = self.base().parameters_si()
                trained = _of(lambda strokes: predict_with(parameters, strokes.samples))
            case "refined":
                trained = _network(fit_refined(self.base(), self.samples, self.setting, _quiet))
            case "mechanisms":
                model, said = self.extended()
                trained = _of(partial(predict_strokes, model), said)
            case "corrected":
                model, said = self.extended()
                fit = fit_correction(model, self.strokes, config=self.analytic, log=_quiet)
                said = {**said, "held_out_l1": list(fit.held_out_l1), "share": fit.share}
                trained = _of(partial(predict_strokes, fit.model), said)
            case _:
                raise ContractError(f"{name} is none of the compared models ({', '.join(NAMES)}).")
        return trained, before + time.process_time() - started

    def base(self) -> Traj2Stroke:
        """Traj2Stroke, trained once."""
        if self._base is None:
            started = time.process_time()
            self._base = train(self.samples, self.analytic, _quiet)
            self._before["traj2stroke"] = time.process_time() - started
        return self._base

    def extended(self) -> tuple[StrokeModel, dict[str, Any]]:
        """Traj2Stroke with the causes that the diagnosis establishes on the training strokes, and the verdict.

        It is done once.
        """
        if self._extended is None:
            base, started = self.base(), time.process_time()
            self._extended = self._found_and_fitted(base)
            self._before["mechanisms"] = self._before["traj2stroke"] + time.process_time() - started
        return self._extended

    def _setting(self, asked_path: Tensor, steps: int) -> Setting:
        an_epoch = max(round((1 - NETWORK.held_out) * len(self.samples.path) / NETWORK.batch), 1)
        sampled = {"pixels_per_m": self.analytic.pixels_per_m, "margin_m": self.analytic.margin_m}
        network = replace(NETWORK, seed=self.seed, epochs=max(round(steps / an_epoch), 1), **sampled)
        return Setting(asked_path, float(self.analytic.margin_m), network)

    def _stamp(self) -> Trained:
        margin, scale = float(self.analytic.margin_m), float(self.analytic.pixels_per_m)
        dark, crisp = (
            fit_stamp(self.samples, margin, scale, lambda stamp, e=error: e(laid(stamp(self.samples), self.samples)))
            for error in (self._l1, self._not_iou)
        )
        return Trained(
            lambda strokes: laid(dark(strokes.samples), strokes.samples),
            lambda strokes: laid(crisp(strokes.samples), strokes.samples),
            {},
        )

    def _polyline(self) -> Trained:
        dark, crisp = (
            fit_polyline(lambda pen, e=error: e(predict_with(pen, self.samples))) for error in (self._l1, self._not_iou)
        )
        return Trained(
            lambda strokes: predict_with(dark, strokes.samples),
            lambda strokes: predict_with(crisp, strokes.samples),
            {},
        )

    def _l1(self, predicted: Tensor) -> float:
        return float(weighted_l1(predicted, self.samples, ANALYTIC.ink_weight))

    def _not_iou(self, predicted: Tensor) -> float:
        return -mean_iou(predicted, self.samples)

    def _found_and_fitted(self, base: Traj2Stroke) -> tuple[StrokeModel, dict[str, Any]]:
        some = np.sort(np.random.default_rng([self.seed, 3]).permutation(self.table.num_rows)[:DIAGNOSED])
        started = time.process_time()
        problem = stroke_problem(load_measured(self.table.take(some)), VOCABULARY, self.seed)
        found = diagnose(problem, seed=self.seed, log=lambda _: None)
        diagnosing = time.process_time() - started
        names = [finding.cause for finding in found.established]
        causes = established_mechanisms(found)
        timing = timing_of(self.strokes.covariates)
        # The base learnt from all of them: to hold some out from its extension alone would favour the base.
        joint = fit_jointly(
            base.parameters_si(),
            causes,
            self.strokes,
            validation=self.strokes,
            timing=timing,
            config=self.analytic,
            log=_quiet,
        )
        model = joint.model
        if not joint.kept and "path_scale" not in names and not is_pressed(self.samples.path):
            model = base_model(train_unscaled(self.samples, self.analytic, _quiet))
        return model, {
            "established": names,
            "suspected": [finding.cause for finding in found.suspected],
            "kept": [m.cause for m in model.mechanisms],
            "weighted_l1": list(joint.validation_l1),
            "diagnosing_s": diagnosing,
        }


def _without_gradients(predict: Predict) -> Predict:
    def predict_only(strokes: MeasuredStrokes) -> Tensor:
        with torch.no_grad():
            return predict(strokes)

    return predict_only


def _network(network: Callable[[StrokeSamples], Tensor]) -> Trained:
    return _of(lambda strokes: predicted(network, strokes.samples))


def _of(predict: Predict, said: Mapping[str, Any] = MappingProxyType({})) -> Trained:
    without = _without_gradients(predict)
    return Trained(without, without, said)


def _quiet(name: str, value: float, step: int) -> None:
    """Nobody watches a study's curves."""
