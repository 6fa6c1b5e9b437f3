"""Decoy columns: readings of a room and an arm that no hidden cause depends on."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Form = Literal["independent", "temporal_drift", "walk", "trend"]

COLUMNS: dict[str, tuple[float, float]] = {
    "temperature_c": (22.0, 1.4),
    "humidity": (0.45, 0.06),
    "battery_v": (24.1, 0.35),
    "operator_mood": (3.0, 1.0),
    "motor_current_a": (1.8, 0.2),
    "room_lux": (410.0, 45.0),
}
"""Name: (mean, standard deviation)."""
FORMS: tuple[Form, ...] = ("independent", "temporal_drift", "walk", "trend")
PERSISTENCE = 0.6  # autoregression coefficient from one action to the next


def draw_decoys(rows: int, seed: int, lively: str | None = None) -> dict[str, NDArray[np.float64]]:
    """All `COLUMNS`, each float64[rows], in a form drawn at random.

    The column `lively` has no trend, so that its effect can be distinguished from wear.
    """
    columns = {}
    for index, (name, (mean, deviation)) in enumerate(COLUMNS.items()):
        rng = np.random.default_rng([seed, 31, index])
        forms = FORMS[:2] if name == lively else FORMS
        columns[name] = mean + deviation * _standard(rng, forms[rng.integers(len(forms))], rows)
    return columns


def _standard(rng: np.random.Generator, form: Form, rows: int) -> NDArray[np.float64]:
    """Mean 0 and standard deviation 1 over the rows."""
    steps = rng.standard_normal(rows)
    match form:
        case "independent":
            values = steps
        case "temporal_drift":
            values = steps.copy()
            for k in range(1, rows):
                values[k] += PERSISTENCE * values[k - 1]
        case "walk":
            values = np.cumsum(steps)
        case "trend":
            values = rng.choice([-1.0, 1.0]) * np.linspace(-1.7, 1.7, rows) + 0.3 * steps
    return (values - values.mean()) / values.std()
