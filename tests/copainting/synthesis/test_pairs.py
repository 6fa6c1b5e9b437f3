"""Paintings of scenes: what a partial painting shows is what the full one shows there, and all hangs on the item."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pentimento.contracts import scenes
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import decode_png
from pentimento.copainting.scenes.ink import ink_mask
from pentimento.copainting.synthesis.pairs import (
    Painter,
    Setting,
    aim,
    fit_labels,
    load_painter,
    missing_thing,
    paint_scene,
    plan_painting,
    sayable,
)
from pentimento.copainting.synthesis.partials import Partial
from pentimento.planning.strokes.render_plan import render_plan
from pentimento.planning.strokes.scene import objective_for
from pentimento.planning.strokes.target import fit_to_canvas
from pentimento.robots.tools import load_tool
from tests.copainting.painters import BRUSH, MARKER, PARTIALS, write_encoder, write_stroke_model

ROWS = scenes.example_table(6).to_pylist()


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("models")
    return write_stroke_model(folder / "stroke"), write_encoder(folder / "semantics")


def painter(folders: tuple[Path, Path], setting: Setting = MARKER) -> Painter:
    return load_painter("marker", setting, *folders)


def test_a_scene_gives_pairs_whose_partials_lack_ink_and_add_none(folders: tuple[Path, Path]) -> None:
    rows = paint_scene(ROWS[0], painter(folders), PARTIALS)
    assert {row["strategy"] for row in rows} >= {"all", "random"}
    full = decode_png(rows[0]["full"]["bytes"])
    assert full.shape == (24, 24, 3) and ink_mask(full).any()
    for row in rows:
        partial = decode_png(row["partial"]["bytes"])
        assert len(row["kept"]) == 8 and not all(row["kept"])
        assert (partial.astype(int) >= full).all() and (partial > full).any()  # black ink only darkens
        assert row["caption"] in ROWS[0]["captions"] and -1 <= row["clip_score"] <= 1
    blank = decode_png(next(row for row in rows if row["strategy"] == "all")["partial"]["bytes"])
    assert (blank == round(0.98 * 255)).all()


def test_a_painting_depends_on_its_scene_and_the_seed_only(folders: tuple[Path, Path]) -> None:
    one = painter(folders)
    alone = paint_scene(ROWS[1], one, PARTIALS)
    paint_scene(ROWS[2], one, PARTIALS)
    assert paint_scene(ROWS[1], one, PARTIALS) == alone
    other = painter(folders, replace(MARKER, planner=replace(MARKER.planner, seed=2)))
    assert paint_scene(ROWS[1], other, PARTIALS)[0]["full"] != alone[0]["full"]


def test_a_plan_comes_nearer_to_its_aim_and_guidance_to_its_meaning(folders: tuple[Path, Path]) -> None:
    from pentimento.semantics.objective import SemanticObjective

    picture = decode_png(ROWS[0]["image"]["bytes"])
    without = replace(MARKER, guidance=None)
    assert MARKER.guidance is not None
    strongly = replace(MARKER, guidance=replace(MARKER.guidance, weight=10.0, iterations=15, views=0))
    means = {}
    for name, setting in {"without": without, "strongly": strongly}.items():
        made = plan_painting(painter(folders, setting), picture, 5)
        objective = objective_for(made.scene, setting.planner)
        meaning = SemanticObjective(painter(folders).encoder, torch.from_numpy(made.scene.target), 0, 0)
        image = render_plan(made.strokes, made.canvas, made.scene)
        assert objective(image)[0] < objective(made.canvas)[0]
        means[name] = float(meaning(torch.from_numpy(image)))
    assert means["strongly"] < means["without"]


def test_a_plan_can_go_on_from_a_canvas(folders: tuple[Path, Path]) -> None:
    canvas = np.full((24, 24, 3), 250, np.uint8)
    canvas[:6] = 20
    made = plan_painting(painter(folders), decode_png(ROWS[0]["image"]["bytes"]), 0, canvas)
    picture = made.picture(np.ones(len(made.strokes), bool), (24, 24))
    assert picture[:5].max() < 40 and (made.picture(np.zeros(len(made.strokes), bool), (24, 24))[8:] > 240).all()


def test_a_brush_paints_in_few_paints_and_its_plan_looks_like_the_scene(folders: tuple[Path, Path]) -> None:
    brush = painter(folders, BRUSH)
    made = plan_painting(brush, decode_png(ROWS[0]["image"]["bytes"]), 0)
    assert len(np.unique(made.strokes.color, axis=0)) <= 3
    assert made.scene.target.std(0).max() > 0


def test_a_tool_with_ink_needs_ink_tones_and_one_without_takes_none(folders: tuple[Path, Path]) -> None:
    with pytest.raises(ConfigError, match="the marker brings its own ink"):
        painter(folders, replace(MARKER, ink=None))
    with pytest.raises(ConfigError, match="the round_brush brings none"):
        painter(folders, replace(BRUSH, ink=MARKER.ink))


def test_black_ink_is_not_told_in_colours() -> None:
    row = {"caption": "a red cup", "captions": ["a red cup", "a cup, just a cup", "a cup"], "colors": ["red"]}
    assert sayable(row, load_tool("marker")) == ["a cup, just a cup", "a cup"]
    assert sayable(row, load_tool("round_brush")) == ["a red cup", "a cup, just a cup", "a cup"]
    assert sayable({"caption": "a red cup", "colors": ["red"]}, load_tool("marker")) == ["a red cup"]


@pytest.mark.parametrize("shape", [(24, 24), (20, 40), (96, 96)])
def test_labels_are_fitted_as_pictures_are(shape: tuple[int, int]) -> None:
    labels = np.zeros((64, 64), np.uint8)
    labels[20:44, 24:50] = 1
    picture = np.repeat(255 * labels[..., None], 3, axis=-1)
    light = fit_to_canvas(picture, shape)[..., 0]
    fitted = fit_labels(labels, shape) == 1
    assert fitted.shape == shape
    assert np.mean((light > 0.5) != fitted) < 0.06
    setting = replace(MARKER, canvas_m=(0.06, 0.06 * shape[0] / shape[1]), ink=None)
    assert aim(picture, setting).shape == (*setting.planned_px, 3)


def test_a_removed_thing_of_several_is_asked_for_by_name_and_in_colour_where_there_are_colours() -> None:
    row = {"objects": ["cat", "orange"], "colors": ["red", "blue"]}
    kept = np.zeros(3, bool)
    second = Partial("semantic", 2, kept)
    assert missing_thing(row, second, load_tool("marker")) == "an orange"
    assert missing_thing(row, second, load_tool("round_brush")) == "a blue orange"
    assert missing_thing(row | {"colors": None}, second, load_tool("round_brush")) == "an orange"
    for other in (Partial("random", None, kept), Partial("semantic", 3, kept)):
        assert missing_thing(row, other, load_tool("marker")) is None
    assert missing_thing({"objects": ["cat"]}, Partial("semantic", 1, kept), load_tool("marker")) is None
