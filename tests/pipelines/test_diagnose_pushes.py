"""The stage diagnose_pushes: a collection with the pushes that the runner recorded itself."""

import argparse
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import torch
from ruamel.yaml import YAML

import pipelines.diagnose_pushes as stage
from pentimento.contracts.errors import ContractError
from pentimento.contracts.pushes import CONTRACT, example_table
from pentimento.contracts.tables import write_table
from pentimento.control.execute import Session
from pentimento.control.execute_push import execute_push, record_push
from pentimento.control.recording import write_push
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.pushes.measured_scene import scene_of
from pentimento.dynamics.pushes.pose import Crop
from pentimento.dynamics.pushes.push_model import PushFacts, PushModel, write_push_model
from pentimento.robots.tools import load_end_effector
from pentimento.robots.virtual import virtual_sculpting_robot

PUSHES = 4


def recorded(folder: Path, end_effector: str = "ball") -> Path:
    """Pushes in the studio, recorded as the runner records them."""
    robot, tool = virtual_sculpting_robot("foam", 100, 0), load_end_effector(end_effector)
    robot.change_tool(tool)
    for number in range(PUSHES):
        action = np.array([0.08 + 0.01 * number, 0.1, 0.3, 0.02, 0.004])
        executed = execute_push(
            robot, tool, action, robot.scan(), speed_m_s=tool.speed_m_s, dwell_s=0.5, retract_speed_m_s=0.05
        )
        row = record_push(
            Session("sculpture-foam-0", 0.0), number, number, end_effector=tool, material="foam", executed=executed
        )
        write_push(folder, row | {"reset_id": 0, "pushes_since_reset": number})
    return folder


def test_runs_follow_the_collection_as_sessions_with_their_own_history(tmp_path: Path) -> None:
    collection, run = example_table(6), recorded(tmp_path / "run")
    table = stage.with_runs(collection, [run, run])
    assert table.num_rows == 6 + 2 * PUSHES
    ids = np.array(table["action_id"].to_pylist())
    assert len(set(ids)) == table.num_rows and set(ids[:6]) == set(range(6))  # nobody takes a run's push for a repeat
    assert len(set(table["session"].to_pylist())) == 3
    assert {"temperature_c", "humidity"} <= set(table.column_names)
    rows = load_pushes(table.slice(6, PUSHES))[0]
    scene = scene_of(rows)
    assert scene.history_known and not scene.worked[0].any() and scene.worked[-1].max() > 1e-3
    assert pa.types.is_int32(table.schema.field("action_id").type)


def test_runs_with_another_end_effector_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match="pushes of the tool edge and the collection of ball"):
        stage.with_runs(example_table(3), [recorded(tmp_path / "run", "edge")])


@pytest.mark.timeout(600)
def test_the_stage_takes_runs(stage_folder: Path) -> None:
    YAML(typ="safe").dump({"diagnose_pushes": {"seed": 0}}, stage_folder / "params.yaml")
    write_table(stage_folder / "pushes", example_table(20), CONTRACT, "Examples.")
    base = stage_folder / "base"
    base.mkdir()
    torch.manual_seed(0)
    write_push_model(PushModel(PushFacts("push", (("foam", "ball"),), Crop(40, 500.0, 0.03), 4, 0.025, 0.012, 1)), base)
    (base / "held_out_actions.json").write_text(json.dumps([0, 5, 10, 15]))
    stage.main(
        argparse.Namespace(
            material="foam", pushes=stage_folder / "pushes", base=base, runs=[recorded(stage_folder / "run")],
            gap=stage_folder / "gap", out=stage_folder / "out",
        )
    )  # fmt: skip
    verdict = json.loads((stage_folder / "gap/verdict.json").read_text())
    assert verdict["rows"] == 20 + PUSHES
    assert (stage_folder / "out/weights.safetensors").is_file()


def test_a_network_of_pinches_stays_as_it_is(stage_folder: Path) -> None:
    YAML(typ="safe").dump({"diagnose_pushes": {"seed": 0}}, stage_folder / "params.yaml")
    write_table(stage_folder / "pushes", example_table(3), CONTRACT, "Examples.")
    base = stage_folder / "base"
    base.mkdir()
    facts = PushFacts("pinch", (("foam", "gripper"),), Crop(40, 500.0, 0.03), 4, 0.025, 0.012, 1)
    write_push_model(PushModel(facts), base)
    (base / "held_out_actions.json").write_text("[0]")
    places = {name: stage_folder / name for name in ("pushes", "gap", "out")}
    stage.main(argparse.Namespace(material="foam_gripper", base=base, runs=[], **places))
    assert (stage_folder / "out/weights.safetensors").read_bytes() == (base / "weights.safetensors").read_bytes()
    assert "not diagnosed" in json.loads((stage_folder / "gap/verdict.json").read_text())["text"]
