"""The base's pipeline: its parameters, its training in phases, and what ships."""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.images import decode_png
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.copainting.drawings.pairs import DrawnScenesConfig
from pentimento.copainting.goal.planner import load_goal_planner
from pipelines import draw_scenes, export_base, train_goal_base
from pipelines._config import load_section
from pipelines.train_goal_base import TrainGoalBase
from pipelines.train_semantics import TrainSemantics
from tests.copainting.goal_planners import small_encoder
from tests.pipelines.test_goal_planner_stages import SAMPLING, TRAINING

PARAMS = Path(__file__).parents[2] / "base/params.yaml"
PHASE: dict[str, Any] = {"pairs": 6, "blank_share": 0.5, "training": TRAINING}
SECTION: dict[str, Any] = {
    "side_px": 64,
    "start": None,
    "shape": {"unet_channels": [8, 16], "unet_layers": 1, "heads": 2, "prediction": "sample"},
    "vae": {"channels": [8, 8], "latent_channels": 4, "pictures": 4, "steps": 3, "batch": 2, "learning_rate": 1e-3},
    "vae_crop_px": 32,
    "phases": [PHASE, PHASE | {"blank_share": 0.2}],
    "sampling": SAMPLING,
    "threads": 1,
}


def write_params(**sections: Any) -> Path:
    YAML(typ="safe").dump(sections, Path("params.yaml"))
    return Path("params.yaml")


def train(out: str, **changed: Any) -> Path:
    params = write_params(train_goal_base=SECTION | changed)
    train_goal_base.main(argparse.Namespace(params=params, semantics=Path("semantics"), out=Path(out)))
    return Path(out)


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    (stage_folder / "semantics").mkdir()
    small_encoder().save(stage_folder / "semantics")
    return stage_folder


def test_parameters_that_ship_are_read_by_the_stages() -> None:
    scenes = load_section(PARAMS, "draw_scenes", dict[str, DrawnScenesConfig])
    assert not set(scenes["guide"].sources) & set(scenes["judge"].sources)
    assert load_section(PARAMS, "train_goal_base", TrainGoalBase).phases
    assert load_section(PARAMS, "train_semantics", TrainSemantics).encoders


def test_drawn_scenes_keep_the_contract_and_name_their_licence(stage_folder: Path) -> None:
    config = {"scenes": 6, "side_px": 64, "val_share": 0.0, "test_share": 0.3, "wordings": 2, "alone_share": 0.5}
    config |= {"mirrored_share": 0.5, "pen_share": 0.5, "places": "anywhere", "tinted_share": 0.5}
    params = write_params(draw_scenes={"guide": config | {"sources": ["openmoji", "tabler"], "seed": 0}})
    arguments = argparse.Namespace(params=params, reader="guide", archives=Path("semantics"), out=Path("scenes"))
    Path("semantics").mkdir()
    draw_scenes.main(arguments)
    rows = read_table(Path("scenes"), CONTRACT).table.to_pylist()
    assert {(row["source"], row["licence"]) for row in rows} == {("openmoji", "CC-BY-SA-4.0"), ("tabler", "MIT")}
    for row in rows:
        pen = decode_png(row["pen"]["bytes"])
        assert (np.ptp(pen, axis=-1) == 0).all() and pen.max() == 255  # black on white
        assert (decode_png(row["regions"]["bytes"])[pen[..., 0] < 64] > 0).mean() > 0.7 or row["ground"] == "line"


def test_base_is_trained_in_phases_and_training_can_go_on_from_it(folder: Path) -> None:
    base = train("base")
    assert [len(losses) for losses in json.loads((base / "curve.json").read_text())["loss"]] == [4, 4]
    assert json.loads((base / "metrics.json").read_text())["compositions"].keys() == {"seen", "held_out"}
    further = train("further", start="base", phases=[PHASE])
    before, after = (load_goal_planner(place) for place in (base, further))
    assert all((a == b).all() for a, b in zip(before.vae.parameters(), after.vae.parameters(), strict=True))
    assert any((a != b).any() for a, b in zip(before.unet.parameters(), after.unet.parameters(), strict=True))


def test_what_ships_has_hashes_a_licence_and_a_limit_of_size(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    base = train("goal")
    (Path("semantics") / "metrics.json").write_text("{}")
    params = write_params(train_goal_base=SECTION, draw_scenes={"judge": {"sources": ["noto", "twemoji"]}})
    arguments = argparse.Namespace(
        params=params, semantics=Path("semantics"), judge=Path("semantics"), goal=base, out=Path("weights")
    )
    export_base.main(arguments)
    facts = json.loads(Path("weights/base.json").read_text())
    assert facts["licence"] == "CC-BY-SA-4.0" and "goal/unet/diffusion_pytorch_model.safetensors" in facts["sha256"]
    card = Path("weights/card.md").read_text()
    assert "CC BY-SA 4.0" in card and "- noto (Apache-2.0)\n- twemoji (CC-BY-4.0)" in card
    assert load_goal_planner(Path("weights/goal"))
    monkeypatch.setattr(export_base, "_MAX_BYTES", 1000)
    with pytest.raises(PentimentoError, match="take a smaller UNet"):
        export_base.main(arguments)
