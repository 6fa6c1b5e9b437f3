"""Diagnosis of a MuJoCo arm: its log, its simulator and five lines for each possible fault.

`pentimento diagnose log.npz --problem examples.diagnose_your_simulator.arm:problem` names what the simulator lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from examples.diagnose_your_simulator.robot import MODEL, STEP_S
from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.problem import Cause, Quantity, Rows
from pentimento.diagnosis.simulator import Parameter, SimulatorProblem

Array = NDArray[Any]

NUISANCES = (
    Parameter("log_kp_1", 0.0, 0.1),
    Parameter("log_kp_2", 0.0, 0.1),
    Parameter("log_damping_1", 0.0, 0.3),
    Parameter("log_damping_2", 0.0, 0.3),
    Parameter("zero_1_rad", 0.0, 0.01),
    Parameter("zero_2_rad", 0.0, 0.01),
)
_SPEEDS = ("speed_1_rad_s", "speed_2_rad_s", "duration_s", "way_1_rad", "way_2_rad")
CAUSES = (
    Cause("backlash", (Quantity("play_rad", "rad", 0.005, signed=False),), _SPEEDS, family="motion"),
    Cause("sensor_delay", (Quantity("delay_s", "s", 0.01, signed=False),), _SPEEDS, family="motion"),
    Cause(
        "dry_friction",
        (Quantity("friction_1_nm", "N m", 0.5, signed=False), Quantity("friction_2_nm", "N m", 0.3, signed=False)),
        _SPEEDS,
        family="motion",
    ),
    Cause("link_mass", (Quantity("log_mass", "1", 0.1),), (*_SPEEDS, "lever_m"), family="load"),
)
_SETTLE = 150  # steps of rest before the log begins


def problem(log: Path, seed: int = 0) -> SimulatorProblem:
    """The problem of an arm's log (`robot.make_log`)."""
    try:
        with np.load(log) as columns:
            return problem_of(dict(columns), seed)
    except (OSError, EOFError, ValueError, KeyError) as error:
        raise ContractError(f"{log} is no log of the arm ({error}); make one with robot.py.") from error


def problem_of(log: Mapping[str, Array], seed: int) -> SimulatorProblem:
    """The same from columns."""
    given = ("commanded_rad", "measured_rad", "action", "block")
    covariates = {name: values.astype(float) for name, values in log.items() if name not in given}
    rows = Rows(log["action"], log["block"], np.arange(len(log["action"])), covariates)
    measured = log["measured_rad"].reshape(len(rows.action), -1) * 1e3
    causes = {cause.name: cause for cause in CAUSES}
    predict = predictor(log["commanded_rad"])
    return SimulatorProblem(
        predict,
        measured,
        NUISANCES,
        causes,
        rows,
        kind="motions",
        unit="mrad²",
        seed=seed,
        index=np.arange(len(measured)),
    )


def predictor(commanded_rad: Array) -> Callable[[Array, Mapping[str, float]], Array]:
    """The simulator: indices of motions and parameter values to readings, mrad [B, 2 T]."""

    @lru_cache(maxsize=256)  # fits return to the same parameters often
    def joints(kp: tuple[float, ...], damping: tuple[float, ...], friction: tuple[float, ...], mass: float) -> Array:
        model = mujoco.MjModel.from_xml_path(str(MODEL))
        model.actuator_gainprm[:, 0] *= np.exp(kp)
        model.actuator_biasprm[:, 1] *= np.exp(kp)
        model.dof_damping *= np.exp(damping)
        model.dof_frictionloss[:] = np.maximum(friction, 0.0)
        model.body_mass[2] *= np.exp(mass)
        model.body_inertia[2] *= np.exp(mass)
        return simulated(model, commanded_rad)

    def predict(index: Array, value: Mapping[str, float]) -> Array:
        kp = value["log_kp_1"], value["log_kp_2"]
        damping = value["log_damping_1"], value["log_damping_2"]
        friction = value["friction_1_nm"], value["friction_2_nm"]
        read = joints(kp, damping, friction, value["log_mass"])[index]
        velocity = np.gradient(read, STEP_S, axis=1)
        read = following(read, 0.5 * value["play_rad"])
        read = read - value["delay_s"] * velocity
        read = read + np.array([value["zero_1_rad"], value["zero_2_rad"]])
        return np.asarray(read.reshape(len(index), -1) * 1e3)

    return predict


def following(read_rad: Array, half_rad: float) -> Array:
    """Readings [B, T, 2] of a sensor whose gear has play: it follows once the link has taken up half the play."""
    sensor = read_rad.copy()
    for k in range(1, sensor.shape[1]):
        sensor[:, k] = np.clip(sensor[:, k - 1], read_rad[:, k] - half_rad, read_rad[:, k] + half_rad)
    return sensor


def simulated(model: mujoco.MjModel, commanded_rad: Array) -> Array:
    """Joint angles [B, T, 2] for commands [B, T, 2]; each motion begins at rest."""
    data = mujoco.MjData(model)
    control = np.concatenate([np.repeat(commanded_rad[:, :1], _SETTLE, axis=1), commanded_rad], axis=1)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.zeros((len(control), size))
    start[:, 1 : 1 + model.nq] = commanded_rad[:, 0]  # after the time
    states, _ = rollout.rollout(model, data, start, control)
    return np.asarray(states[:, _SETTLE:, 1 : 1 + model.nq])
