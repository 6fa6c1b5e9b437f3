"""The robot whose logs are diagnosed. It differs from the simulator in form: its faults have equations of their own.

`python -m examples.diagnose_your_simulator.robot --hides backlash --seed 3 --out log.npz` makes a log.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError

Array = NDArray[Any]

FAULTS: Final = ("nothing", "backlash", "sensor_delay", "dry_friction", "link_mass")
STEP_S: Final = 0.004
"""Of commands and of the log."""
_STEPS = 150
_SINGLE, _REPEATED, _TIMES = 64, 16, 2
_NOISE_RAD = 4e-4
"""Standard deviation of a reading."""
_TORQUE_NOISE_NM = 0.05
"""Standard deviation of a motor's constant error in one motion: repeats differ by it."""
MODEL: Final = Path(__file__).with_name("arm.xml")


def drawn_fault(seed: int) -> tuple[str, float]:
    """The fault of the robot with this seed, in turn, and its strength, half to twice the usual one."""
    strength = np.exp(np.random.default_rng([seed, 9]).uniform(np.log(0.5), np.log(2.0)))
    return FAULTS[seed % len(FAULTS)], float(strength)


def make_log(fault: str, seed: int, strength: float) -> dict[str, Array]:
    """Execute random motions on a robot with one fault.

    Args:
        fault: one of ``FAULTS``.
        seed: of the robot and of its motions.
        strength: of the fault; 1 is clearly visible.

    Returns:
        Columns by name: ``commanded_rad`` and ``measured_rad`` [B, T, 2]; ``action``, ``block`` and covariates
        [B].

    Raises:
        ConfigError: no such fault.
    """
    if fault not in FAULTS:
        raise ConfigError(f"There is no fault {fault!r}; the robot knows {', '.join(FAULTS)}.")
    rng = np.random.default_rng([seed, 1])
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    gains = np.exp(0.08 * rng.standard_normal(2))
    model.actuator_gainprm[:, 0] *= gains
    model.actuator_biasprm[:, 1] *= gains
    model.dof_damping *= np.exp(0.3 * rng.standard_normal(2))
    if fault == "link_mass":  # something is fixed to the end of the link
        grown = 1 + 0.12 * strength
        model.body_mass[2] *= grown
        model.body_inertia[2] *= grown
        model.body_ipos[2, 0] += 0.02 * strength
    zero_rad, drag = 0.01 * rng.standard_normal(2), 0.02 * rng.random(2)
    commands = [_motion(rng) for _ in range(_SINGLE + _REPEATED)]
    action = rng.permutation(np.concatenate([np.arange(_SINGLE), np.repeat(np.arange(_SINGLE, len(commands)), _TIMES)]))
    measured = [_execute(model, commands[a][0], fault, strength, drag=drag, rng=rng) + zero_rad for a in action]
    rows = len(action)
    columns = {name: np.array([commands[a][1][name] for a in action]) for name in commands[0][1]}
    return columns | {
        "commanded_rad": np.stack([commands[a][0] for a in action]),
        "measured_rad": np.stack(measured),
        "action": action,
        "block": np.arange(rows) // 8,
        "temperature_c": 24 + 3 * np.sin(np.arange(rows) / 25) + 0.2 * rng.standard_normal(rows),
        "battery_v": 24 - 0.01 * np.arange(rows) + 0.05 * rng.standard_normal(rows),
    }


def _motion(rng: np.random.Generator) -> tuple[Array, dict[str, float]]:
    """A smooth motion there and partly back, [T, 2], and its covariates."""
    start, far = rng.uniform(-1.2, 1.2, 2), rng.uniform(-0.6, 0.6, 2)
    duration = float(np.exp(rng.uniform(np.log(0.15), np.log(0.3))))
    back = rng.uniform(0.2, 1.0)
    time = np.arange(_STEPS) * STEP_S

    def smooth(begin: float) -> Array:
        s = np.clip((time - begin) / duration, 0, 1)
        return np.asarray(10 * s**3 - 15 * s**4 + 6 * s**5)

    share = smooth(0.02) - back * smooth(0.02 + duration)
    path = start + far * share[:, None]
    return path, {
        "speed_1_rad_s": abs(far[0]) / duration,
        "speed_2_rad_s": abs(far[1]) / duration,
        "duration_s": duration,
        "way_1_rad": far[0],
        "way_2_rad": far[1],
        "lever_m": float(0.35 * np.cos(start[0]) + 0.3 * np.cos(start.sum())),
    }


def _execute(
    model: mujoco.MjModel, command: Array, fault: str, strength: float, *, drag: Array, rng: np.random.Generator
) -> Array:
    """Readings of the two joints [T, 2]."""
    data = mujoco.MjData(model)
    data.qpos[:] = command[0]
    error_nm = _TORQUE_NOISE_NM * rng.standard_normal(2)
    true = np.empty((len(command), 2))
    settle = [command[0]] * 150  # .6 s of rest before the log begins
    for k, target in enumerate([*settle, *command]):
        data.ctrl[:] = target
        velocity = data.qvel
        data.qfrc_applied[:] = error_nm - drag * velocity * np.abs(velocity)
        if fault == "dry_friction":  # Stribeck: it falls as the joint moves faster
            size = strength * np.array([0.8, 0.5])
            model.dof_frictionloss[:] = size * (0.7 + 0.6 * np.exp(-np.abs(velocity) / 0.3))
        mujoco.mj_step(model, data)
        if k >= len(settle):
            true[k - len(settle)] = data.qpos
    if fault == "backlash":  # the sensor's gear has play with soft flanks, which push the harder the farther they bend
        half = 0.004 * strength
        sensor = true[0].copy()
        for k, link in enumerate(true.copy()):
            for _ in range(8):
                sensor += STEP_S / 8 / 0.02 * half * np.clip((link - sensor) / half, -1.5, 1.5) ** 9
            true[k] = sensor
    if fault == "sensor_delay":
        late = 0.010 * strength / STEP_S
        times = np.maximum(np.arange(len(true)) - late, 0)
        true = np.stack([np.interp(times, np.arange(len(true)), own) for own in true.T], axis=1)
    return true + _NOISE_RAD * rng.standard_normal(true.shape)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m examples.diagnose_your_simulator.robot", description=__doc__)
    parser.add_argument("--hides", choices=FAULTS, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--strength", type=float, default=1.0)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    np.savez_compressed(given.out, **make_log(given.hides, given.seed, given.strength))


if __name__ == "__main__":
    main()
