"""One diagnosis of example strokes for all tests of its outputs."""

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.diagnose import Finding
from pentimento.diagnosis.evidence import Evidence
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.next_actions import Proposal, proposal_for, screen
from pentimento.diagnosis.strokes.problem import StrokeResult
from pentimento.diagnosis.strokes.report import StrokeScreening
from pentimento.diagnosis.strokes.write import write_diagnosis

FOUND = Finding(
    cause="bristle_lag",
    probability=0.97,
    gain=0.41,
    gain_interval=(0.2, 0.6),
    values={"distance_m": (0.0042, 0.0003)},
    evidence=Evidence(4.0, 2.5, 0.4, 4.0, 0.8, 0.5, 9.0, 0.1, 0.2, 1.0, 1.1),
    rivals=("latency",),
    mse_without=4e-4,
)
"""An established lag."""


@dataclass(frozen=True, eq=False)
class Written:
    """The output of a diagnosis of the example strokes, and its inputs."""

    folder: Path
    lines: list[str]
    result: StrokeResult
    measured: Measured
    screening: StrokeScreening
    proposal: Proposal


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """The strokes grow paler with the length drawn since the last dip; the last row is a copy of the first."""
    folder, lines, table = tmp_path_factory.mktemp("diagnosis") / "out", list[str](), example_table(56)
    result = write_diagnosis(pa.concat_tables([table, table.slice(0, 1)]), folder, 0, log=lines.append)
    measured = load_measured(table)
    seen = screen(result)
    return Written(folder, lines, result, measured, seen, proposal_for(result, seen, 0))
