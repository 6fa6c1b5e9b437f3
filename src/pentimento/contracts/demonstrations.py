"""The `demonstrations` table: strokes drawn by people, for the prior over trajectories."""

from typing import Any, Final

import numpy as np
import pyarrow as pa

from pentimento.contracts.schema import PATH, TableContract, arrow_schema, needed, vector

CONTRACT: Final = TableContract(
    name="demonstrations",
    description="One row for each stroke that a person drew; points in a standard frame and size.",
    columns=(
        needed("session", pa.string(), "one uninterrupted recording"),
        needed("hand", pa.string(), "who drew it"),
        needed("index", pa.int32(), "order in the session"),
        needed(
            "points",
            PATH,
            "t from the stroke's start, x, y, z, pressure in 0..1; NaN = unknown in t, z and pressure",
            "s, m, m, m, 1",
            "standard",
            may_be_nan=(0, 3, 4),
        ),
        needed(
            "standard_to_source",
            vector(3),
            "x, y, theta of the standard frame in the source's",
            "m, m, rad",
            "source",
        ),
    ),
)


def example_table(n: int, seed: int = 0) -> pa.Table:
    """`n` plausible strokes: bends that slow down where they curve; row i depends on (seed, i) only."""
    rows = [_example_row(index, seed) for index in range(n)]
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT))


def _example_row(index: int, seed: int) -> dict[str, Any]:
    generator = np.random.default_rng([seed, index])
    length_m, turn_rad = generator.uniform(0.01, 0.06), generator.uniform(-2.5, 2.5)
    s = np.linspace(0.0, 1.0, 32)
    heading = turn_rad * (s - 0.5) ** 3 * 8 / 2
    step_m = length_m / (len(s) - 1)
    x = np.concatenate([[0.0], np.cumsum(np.cos(heading[1:]))]) * step_m
    y = np.concatenate([[0.0], np.cumsum(np.sin(heading[1:]))]) * step_m
    t = np.concatenate([[0.0], np.cumsum(step_m / (0.08 / (1.0 + np.abs(np.diff(heading)) * 5)))])
    pressure = 0.2 + 0.7 * np.sin(np.pi * s)
    points = np.column_stack([t, x, y, np.full_like(s, np.nan), pressure])
    return {
        "session": f"example_{seed}",
        "hand": f"hand_{index % 2}",
        "index": index,
        "points": points.tolist(),
        "standard_to_source": generator.uniform([0, 0, -np.pi], [0.2, 0.15, np.pi]).tolist(),
    }
