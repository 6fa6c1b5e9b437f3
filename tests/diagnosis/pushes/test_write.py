"""Files of a push diagnosis, written by the library and by the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pentimento.cli.main import main
from pentimento.contracts.pushes import CONTRACT, example_table
from pentimento.contracts.tables import write_table
from pentimento.diagnosis.pushes.next_pushes import (
    PushProposal,
    PushScreening,
    as_measured,
    as_table,
    proposal_for,
    screen,
)
from pentimento.diagnosis.pushes.page import build_page
from pentimento.planning.pushes.analytic.model import model_as_json, model_from_json
from tests.diagnosis.pushes.conftest import Played


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Output folder of the command for example pushes, a third of them repeated."""
    place = tmp_path_factory.mktemp("diagnosed")
    table = example_table(24)
    ids = pa.array(np.where(np.arange(24) < 16, np.arange(24), np.arange(24) - 8).astype(np.int32))
    actions = table["action"].to_pylist()
    actions[16:] = actions[8:16]
    table = table.set_column(table.column_names.index("action_id"), table.schema.field("action_id"), ids)
    kind = table.schema.field("action")
    table = table.set_column(table.column_names.index("action"), kind, pa.array(actions, kind.type))
    write_table(place / "rows", table, CONTRACT, "# Card")
    assert main(["diagnose", str(place / "rows"), "--out", str(place / "out")]) == 0
    return place / "out"


def test_command_detects_pushes_by_columns(out: Path) -> None:
    verdict = json.loads((out / "verdict.json").read_text())
    assert verdict["schema"] == 2 and verdict["kind"] == "pushes" and verdict["actions"] == 16
    assert {"extended_model.json", "next_actions.parquet", "report.html", "figures"} <= {p.name for p in out.iterdir()}
    page = (out / "report.html").read_text()
    assert verdict["text"].splitlines()[0] in page and "data:image/png" in page


def test_command_rejects_stroke_options_for_pushes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_table(tmp_path / "rows", example_table(3), CONTRACT, "# Card")
    given = ["diagnose", str(tmp_path / "rows"), "--out", str(tmp_path / "out"), "--collect", "2"]
    assert main(given) == 1
    assert "--collect is for strokes" in capsys.readouterr().err


def test_extended_model_round_trips(lossy: Played, tmp_path: Path) -> None:
    model, width = lossy.result.extended.model, lossy.measured.scene.half_width_m
    path = tmp_path / "extended_model.json"
    path.write_text(json.dumps(model_as_json(model, width)))
    again, read_width = model_from_json(json.loads(path.read_text()))
    assert read_width == width
    scene = lossy.measured.scene.pick(np.arange(4))
    assert np.array_equal(again.change(scene), model.change(scene))


@pytest.fixture(scope="module")
def screened(lossy: Played) -> tuple[PushScreening, PushProposal]:
    screening = screen(lossy.result)
    return screening, proposal_for(lossy.result, screening, 0)


def test_proposed_pushes_are_feasible_pairs(lossy: Played, screened: tuple[PushScreening, PushProposal]) -> None:
    _, proposal = screened
    table = pq.ParquetFile(pa.BufferReader(_bytes(as_table(proposal)))).read()
    assert table.num_rows == 16 and table["smooth"].to_pylist() == [True, False] * 8
    action = np.array(table["action"].to_pylist())
    recorded = lossy.measured.scene.action
    assert (action[:, 3:] >= recorded[:, 3:].min(0) - 1e-6).all()
    assert (action[:, 3:] <= recorded[:, 3:].max(0) + 1e-6).all()
    planned = as_measured(proposal.action, proposal.settings, lossy.result.extended.model, lossy.measured)
    second = np.arange(1, 16, 2)
    assert not planned.scene.worked[second - 1].any() and (planned.scene.worked[second].max((1, 2)) > 0).all()
    for before, after in proposal.aliasing.values():
        assert after <= before + 1e-6


def test_report_page_is_reproducible(lossy: Played, screened: tuple[PushScreening, PushProposal]) -> None:
    verdict = {
        "text": "It loses volume. A note.",
        "kind": "pushes",
        "rows": 49,
        "actions": 35,
        "mse": {"floor": 0.01},
    }
    one, other = (build_page(lossy.result, *screened, verdict) for _ in range(2))
    assert one == other and b"volume_loss" in one["report.html"] and b"A note." in one["report.html"]


def _bytes(table: pa.Table) -> pa.Buffer:
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink)
    return sink.getvalue()
