"""Shared by the experiments: settings, a robot in front of smooth clay, goals, pushes and push models that are made
once, and a sculptor that times its plans."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pentimento.collection.pushes import PushCollectionConfig, collect_pushes
from pentimento.contracts.atomic import atomic_folder, atomic_write
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.control.sculpting_settings import SculptingSettings
from pentimento.control.sculptor import Sculptor
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from pentimento.dynamics.pushes.pose import in_pose
from pentimento.dynamics.pushes.push_model import TorchClay, planned_members, read_push_model, write_push_model
from pentimento.dynamics.pushes.training import TrainingConfig, crop_for, train
from pentimento.goals3d.reliefs import place, soften
from pentimento.goals3d.sources import relief_of
from pentimento.planning.pushes.goal import fit_goal
from pentimento.planning.pushes.plan import PushPlan
from pentimento.robots.driver import SculptingRobot
from pentimento.robots.tools import EndEffector, load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot
from pipelines._config import load_section
from pipelines.collect_pushes import CollectPushes
from pipelines.sculpt import Sculpt
from studies.sculpting.shapes import face, knot

Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_RELIEF_PX = 256
"""Side of the reliefs of the face and the knot before they are placed."""


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
        rows = collect_pushes(robot, end_effector, material, given.collection, unheard)
        samples, _ = load_pushes(pa.Table.from_pylist(rows), given.training.pixels_per_m)
        crop = crop_for(samples, given.training)
        context = [(material, tool)]
        model = train(in_pose(samples, crop), end_effector.kind, context, crop=crop, config=given.training, log=unheard)
        models.mkdir(parents=True, exist_ok=True)
        with atomic_folder(folder) as out:
            write_push_model(model, out)
    return planned_members(read_push_model(folder), window_m)


def unheard(_name: str, _value: float, _step: int) -> None:
    """Discards the training curves."""


def goal_on(source: str, height: Array, sculpting: SculptingSettings) -> Array:
    """The goal [H, W] of ``face``, ``knot`` or a source of ``relief_of``, fitted to clay [H, W] on a slab of 0.2 m."""
    shape = (height.shape[0], height.shape[1])
    soften_px = sculpting.edge_blur_m * shape[1] / 0.2
    if source in ("face", "knot"):
        relief = {"face": face, "knot": knot}[source](_RELIEF_PX)
        relief = soften(place(relief, shape, sculpting.side_share), soften_px)
    else:
        relief = relief_of(source, shape, sculpting.side_share, soften_px=soften_px)
    return fit_goal(relief, height, sculpting.fit).height_m


def pushes_of(material: str, tool: str, given: Settings, folder: Path, seed: int) -> PushSamples:
    """Pushes of a seed into a slab of that seed; they are collected once, into ``folder``."""
    file = folder / f"pushes_{seed}.parquet"
    if not file.is_file():
        robot, end_effector = robot_with(material, tool, given.collection.scan_pixels, seed)
        rows = collect_pushes(robot, end_effector, material, replace(given.collection, seed=seed), unheard)
        sink = pa.BufferOutputStream()
        pq.write_table(pa.Table.from_pylist(rows), sink)
        atomic_write(file, sink.getvalue().to_pybytes())
    return load_pushes(pq.read_table(file), given.training.pixels_per_m)[0]


def once(folder: Path, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What ``make`` returns, from its JSON file in ``folder`` if there is one."""
    file = folder / f"{name}.json"
    if not file.is_file():
        atomic_write(file, (json.dumps(make(), indent=1) + "\n").encode())
        print(name, flush=True)
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


@dataclass
class Clock:
    """Time that planning has taken."""

    wall_s: float = 0.0
    cpu_s: float = 0.0
    plans: int = 0


@dataclass(frozen=True, kw_only=True)
class TimedSculptor(Sculptor):
    """A sculptor that times its plans."""

    clock: Clock

    def _plan(self, height: Array, executed: tuple[FloatArray, ...], *, begun: FloatArray | None) -> PushPlan:
        wall, cpu = time.perf_counter(), time.process_time()
        made = super()._plan(height, executed, begun=begun)
        self.clock.wall_s += time.perf_counter() - wall
        self.clock.cpu_s += time.process_time() - cpu
        self.clock.plans += 1
        return made
