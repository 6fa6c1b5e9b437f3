"""A toy simulator: a spring that is pulled along a ramp. The real one is stiffer when it is pulled fast or is worn."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.problem import Cause, Quantity, Rows
from pentimento.diagnosis.simulator import Parameter, SimulatorProblem

Array = NDArray[Any]

_TIME = np.linspace(0, 1, 16)
_NOISE_N = 0.05
CAUSES = (
    Cause("rate_stiffening", (Quantity("per_speed", "1", 0.1, signed=False),), ("speed_m_s",)),
    Cause("wear", (Quantity("per_turn", "1", 0.1),), ("turn",)),
    Cause("late_sensor", (Quantity("delay_s", "s", 0.02, signed=False),), ("speed_m_s", "length_m")),
)


def spring(*, rate: float = 0.0, wear: float = 0.0, warmth: float = 0.0, seed: int = 0) -> SimulatorProblem:
    """Pull a spring: 72 single ways and 18 three times. ``warmth`` is an effect without a name."""
    rng = np.random.default_rng(seed)
    command = np.stack([rng.uniform(0.5, 1.5, 90), rng.uniform(0.5, 3.0, 90)], axis=1)
    action = rng.permutation(np.concatenate([np.arange(72), np.repeat(np.arange(72, 90), 3)]))
    length, speed = command[action].T
    turn = np.arange(len(action))
    temperature = rng.normal(size=len(action))
    covariates = {
        "length_m": length, "speed_m_s": speed, "turn": turn / len(turn), "temperature_c": temperature,
    }  # fmt: skip
    stiffness = 2.0 * (1 + rate * np.tanh(0.6 * speed)) * (1 + wear * (turn / len(turn)) ** 1.3)
    stiffness = stiffness * (1 + warmth * temperature)
    force = stiffness[:, None] * length[:, None] * _TIME + 0.3
    force += _NOISE_N * rng.standard_normal(force.shape)
    force *= 1 + 0.01 * rng.standard_normal((len(force), 1))  # no motion is repeated exactly

    def predict(index: Array, value: Mapping[str, float]) -> Array:
        own = {name: column[index, None] for name, column in covariates.items()}
        factor = 1 + value["per_speed"] * own["speed_m_s"] + value["per_turn"] * (own["turn"] - 0.5)
        time = _TIME - value["delay_s"] * own["speed_m_s"] * np.sqrt(_TIME)
        return np.exp(value["log_stiffness"]) * factor * own["length_m"] * time + value["zero_n"]

    return SimulatorProblem(
        predict,
        force,
        (Parameter("log_stiffness", 0.5, 0.2), Parameter("zero_n", 0.0, 0.2)),
        {cause.name: cause for cause in CAUSES},
        Rows(action, turn // 9, turn, covariates),
        kind="pulls",
        unit="N²",
        seed=0,
        index=turn,
    )


def worn_spring(_log: Path, seed: int) -> SimulatorProblem:
    """A spring that wears, as `pentimento diagnose --problem` makes it."""
    return spring(wear=0.2, seed=seed)
