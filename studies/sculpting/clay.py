"""Shared by the experiments: settings, a robot in front of smooth clay, and push models that are trained once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.collection.pushes import PushCollectionConfig, collect_pushes
from pentimento.contracts.atomic import atomic_folder
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculpting_settings import SculptingSettings
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.pushes.pose import in_pose
from pentimento.dynamics.pushes.push_model import TorchClay, planned_members, read_push_model, write_push_model
from pentimento.dynamics.pushes.training import TrainingConfig, crop_for, train
from pentimento.robots.driver import SculptingRobot
from pentimento.robots.tools import EndEffector, load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot
from pipelines._config import load_section
from pipelines.collect_pushes import CollectPushes
from pipelines.sculpt import Sculpt

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Settings:
    """The sections of params.yaml that the experiments start from."""

    collection: PushCollectionConfig
    training: TrainingConfig
    sculpting: SculptingSettings
    """Of foam."""
    sculpt: Sculpt

    @property
    def grid(self) -> tuple[int, int]:
        """Of the height maps of push models, [h, w]; the slab is square."""
        return self.collection.scan_pixels, self.collection.scan_pixels


def settings(params: Path) -> Settings:
    """Read params.yaml."""
    sculpt = load_section(params, "sculpt", Sculpt)
    return Settings(
        load_section(params, "collect_pushes", CollectPushes).collection,
        load_section(params, "train_push_dynamics", TrainingConfig),
        sculpt.settings["foam"].sculpting,
        sculpt,
    )


def robot_with(material: str, tool: str, scan_pixels: int, seed: int) -> tuple[SculptingRobot, EndEffector]:
    """A guarded robot in front of smooth material, and the end-effector of that name."""
    end_effector = load_end_effector(tool)
    raw = virtual_sculpting_robot(material, scan_pixels, seed)
    return GuardedSculptingRobot(raw, push_envelope_for(end_effector, raw.area_m)), end_effector


def model_of(material: str, tool: str, given: Settings, models: Path, window_m: FloatArray) -> tuple[TorchClay, ...]:
    """The ensemble of push models of a material and a tool in ``models``; a missing one is trained and saved there."""
    folder = models / f"{material}_{tool}"
    if not folder.is_dir():
        robot, end_effector = robot_with(material, tool, given.collection.scan_pixels, given.collection.seed)
        rows = collect_pushes(robot, end_effector, material, given.collection, _unheard)
        samples, _ = load_pushes(pa.Table.from_pylist(rows), given.training.pixels_per_m)
        crop = crop_for(samples, given.training)
        context = [(material, tool)]
        model = train(
            in_pose(samples, crop), end_effector.kind, context, crop=crop, config=given.training, log=_unheard
        )
        models.mkdir(parents=True, exist_ok=True)
        with atomic_folder(folder) as out:
            write_push_model(model, out)
    return planned_members(read_push_model(folder), window_m)


def _unheard(_name: str, _value: float, _step: int) -> None:
    """Discards the training curves."""
