"""One diagnosis of example strokes for all tests of its outputs."""

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.diagnose import Diagnosis
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.next_actions import Proposal, proposal_for, screen
from pentimento.diagnosis.strokes.report import StrokeScreening
from pentimento.diagnosis.strokes.write import write_diagnosis


@dataclass(frozen=True, eq=False)
class Written:
    """The output of a diagnosis of the example strokes, and its inputs."""

    folder: Path
    lines: list[str]
    diagnosis: Diagnosis
    measured: Measured
    screening: StrokeScreening
    proposal: Proposal


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """The strokes grow paler with the length drawn since the last dip; the last row is a copy of the first."""
    folder, lines, table = tmp_path_factory.mktemp("diagnosis") / "out", list[str](), example_table(56)
    diagnosis = write_diagnosis(pa.concat_tables([table, table.slice(0, 1)]), folder, 0, log=lines.append)
    measured = load_measured(table)
    seen = screen(diagnosis)
    return Written(folder, lines, diagnosis, measured, seen, proposal_for(diagnosis, seen, 0))
