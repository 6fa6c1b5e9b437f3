"""One diagnosis of made-up strokes, for all tests of what is made of it."""

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.diagnose import Diagnosis
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.next_actions import Proposal, Survey, proposal_for, survey
from pentimento.diagnosis.strokes.write import write_diagnosis


@dataclass(frozen=True, eq=False)
class Written:
    """What a diagnosis of the example strokes left behind, and what it was made of."""

    folder: Path
    lines: list[str]
    diagnosis: Diagnosis
    measured: Measured
    survey: Survey
    proposal: Proposal


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """They grow paler with the length drawn since the last dip; the last row is a copy of the first."""
    folder, lines, table = tmp_path_factory.mktemp("diagnosis") / "out", list[str](), example_table(56)
    diagnosis = write_diagnosis(pa.concat_tables([table, table.slice(0, 1)]), folder, 0, lines.append)
    measured = load_measured(table)
    seen = survey(diagnosis)
    return Written(folder, lines, diagnosis, measured, seen, proposal_for(diagnosis, seen, 0))
