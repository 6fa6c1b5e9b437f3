"""Plans of scenes, and pairs of a partial and a full painting."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pentimento.contracts import scenes
from pentimento.contracts.copaintings import CONTRACT
from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import decode_png, encode_png
from pentimento.contracts.schema import arrow_schema
from pentimento.copainting.synthesis.painter import Painter, Setting, load_painter, plan_painting, plan_target
from pentimento.copainting.synthesis.pairs import (
    Row,
    beside_pairs,
    fit_labels,
    missing_thing,
    overlay,
    paint_scene,
    usable_captions,
    window_pairs,
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
    folder = tmp_path_factory.mktemp("models")
    return write_stroke_model(folder / "stroke"), write_encoder(folder / "semantics")


def painter(folders: tuple[Path, Path], setting: Setting = MARKER) -> Painter:
    return load_painter("marker", setting, *folders)


def test_partial_paintings_only_lack_ink_of_the_full_one(folders: tuple[Path, Path]) -> None:
    rows = paint_scene(ROWS[0], painter(folders), PARTIALS)
    assert {row["strategy"] for row in rows} >= {"all", "random"}
    full = decode_png(rows[0]["full"]["bytes"])
    blank_level = round(0.98 * 255)
    assert full.shape == (24, 24, 3) and (full < blank_level).any()
    for row in rows:
        partial = decode_png(row["partial"]["bytes"])
        assert len(row["kept"]) == 8 and not all(row["kept"])
        assert (partial.astype(int) >= full).all() and (partial > full).any()  # black ink only darkens
        assert row["caption"] in ROWS[0]["captions"] and -1 <= row["clip_score"] <= 1
    blank = decode_png(next(row for row in rows if row["strategy"] == "all")["partial"]["bytes"])
    assert (blank == blank_level).all()


def test_painting_depends_on_its_scene_and_the_seed_only(folders: tuple[Path, Path]) -> None:
    one = painter(folders)
    alone = paint_scene(ROWS[1], one, PARTIALS)
    paint_scene(ROWS[2], one, PARTIALS)
    assert paint_scene(ROWS[1], one, PARTIALS) == alone
    other = painter(folders, replace(MARKER, planner=replace(MARKER.planner, seed=2)))
    assert paint_scene(ROWS[1], other, PARTIALS)[0]["full"] != alone[0]["full"]


def test_plan_lowers_its_objective_and_guidance_the_semantic_one(folders: tuple[Path, Path]) -> None:
    from pentimento.semantics.objective import SemanticObjective

    picture = decode_png(ROWS[0]["image"]["bytes"])
    without = replace(MARKER, guidance=None)
    assert MARKER.guidance is not None
    strongly = replace(MARKER, guidance=replace(MARKER.guidance, weight=10.0, iterations=15, views=0))
    means = {}
    for name, setting in {"without": without, "strongly": strongly}.items():
        result = plan_painting(painter(folders, setting), picture, 5)
        objective = objective_for(result.scene, setting.planner)
        meaning = SemanticObjective(painter(folders).encoder, torch.from_numpy(result.scene.target), 0, 0)
        image = render_plan(result.strokes, result.canvas, result.scene)
        assert objective(image)[0] < objective(result.canvas)[0]
        means[name] = float(meaning(torch.from_numpy(image)))
    assert means["strongly"] < means["without"]


def test_plan_continues_from_a_canvas(folders: tuple[Path, Path]) -> None:
    canvas = np.full((24, 24, 3), 250, np.uint8)
    canvas[:6] = 20
    result = plan_painting(painter(folders), decode_png(ROWS[0]["image"]["bytes"]), 0, canvas)
    picture = result.picture(np.ones(len(result.strokes), bool), (24, 24))
    assert picture[:5].max() < 40 and (result.picture(np.zeros(len(result.strokes), bool), (24, 24))[8:] > 240).all()


def test_brush_plan_uses_a_limited_palette(folders: tuple[Path, Path]) -> None:
    brush = painter(folders, BRUSH)
    result = plan_painting(brush, decode_png(ROWS[0]["image"]["bytes"]), 0)
    assert len(np.unique(result.strokes.color, axis=0)) <= 3
    assert result.scene.target.std(0).max() > 0


def test_rejects_ink_tones_for_a_tool_without_ink(folders: tuple[Path, Path]) -> None:
    with pytest.raises(ConfigError, match="the round_brush has none"):
        painter(folders, replace(BRUSH, ink=MARKER.ink))


def test_captions_for_black_ink_have_no_colours() -> None:
    row = {"caption": "a red cup", "captions": ["a red cup", "a cup, just a cup", "a cup"], "colors": ["red"]}
    assert usable_captions(row, load_tool("marker")) == ["a cup, just a cup", "a cup"]
    assert usable_captions(row, load_tool("round_brush")) == ["a red cup", "a cup, just a cup", "a cup"]
    assert usable_captions({"caption": "a red cup", "colors": ["red"]}, load_tool("marker")) == ["a red cup"]


@pytest.mark.parametrize("shape", [(24, 24), (20, 40), (96, 96)])
def test_labels_are_fitted_like_pictures(shape: tuple[int, int]) -> None:
    labels = np.zeros((64, 64), np.uint8)
    labels[20:44, 24:50] = 1
    picture = np.repeat(255 * labels[..., None], 3, axis=-1)
    light = fit_to_canvas(picture, shape)[..., 0]
    fitted = fit_labels(labels, shape) == 1
    assert fitted.shape == shape
    assert np.mean((light > 0.5) != fitted) < 0.06
    setting = replace(MARKER, canvas_m=(0.06, 0.06 * shape[0] / shape[1]), ink=None)
    assert plan_target(picture, setting).shape == (*setting.planned_px, 3)


def test_missing_thing_is_named_with_colour_for_coloured_tools() -> None:
    row = {"objects": ["cat", "orange"], "colors": ["red", "blue"]}
    kept = np.zeros(3, bool)
    second = Partial("semantic", 2, kept)
    assert missing_thing(row, second, load_tool("marker")) == "an orange"
    assert missing_thing(row, second, load_tool("round_brush")) == "a blue orange"
    assert missing_thing(row | {"colors": None}, second, load_tool("round_brush")) == "an orange"
    for other in (Partial("random", None, kept), Partial("semantic", 3, kept)):
        assert missing_thing(row, other, load_tool("marker")) is None
    assert missing_thing({"objects": ["cat"]}, Partial("semantic", 1, kept), load_tool("marker")) is None


PAPER = np.full((16, 16, 3), 250, np.uint8)
KINDS = ("cup", "sun", "tree", "key", "cat", "fish")
TOGETHER = {frozenset((a, b)) for a in KINDS for b in KINDS} - {frozenset(("cup", "sun"))}


def png(picture: np.ndarray) -> dict[str, Any]:
    return {"bytes": encode_png(picture), "path": None}


def paintings() -> tuple[list[Row], dict[str, dict[str, Any]]]:
    rows, scenes = [], {}
    for place, kind in enumerate(KINDS):
        left = place % 2 == 0
        picture = PAPER.copy()
        picture[2 * place + 1, slice(1, 7) if left else slice(9, 15)] = 10
        name = f"scene_{place}/{'left' if left else 'right'}"
        scenes[name] = {"scene_id": name, "arrangement": name.split("/")[1], "objects": [kind]}
        rows.append({
            "scene_id": name, "setting": "marker", "strategy": "all", "region": None, "seed": place, "caption": "a bar",
            "medium": "with a marker", "partial": png(PAPER), "full": png(picture), "plan_id": f"plan_{place}",
            "kept": [False] * (place + 1), "clip_score": place / 10, "scorer": "s",
            "split": "val" if place >= 4 else "train",
        })  # fmt: skip
    return rows, scenes


def pairs(number: int = 9, seed: int = 0) -> list[Row]:
    rows, scenes = paintings()
    return beside_pairs(
        rows, scenes, lambda scene: [f"just a {scene['objects'][0]}"], together=TOGETHER, number=number, seed=seed
    )


def test_beside_pair_shows_one_thing_and_asks_for_the_other() -> None:
    for row in pairs():
        there, asked = (int(name.removeprefix("plan_")) for name in row["plan_id"].split(" + "))
        before, after = decode_png(row["partial"]["bytes"]), decode_png(row["full"]["bytes"])
        assert set(np.flatnonzero((before < 100).any((1, 2)))) == {2 * there + 1}
        assert set(np.flatnonzero((after < 100).any((1, 2)))) == {2 * there + 1, 2 * asked + 1}
        assert (after[before < 100] < 100).all()
        assert row["kept"] == [True] * (there + 1) + [False] * (asked + 1)
        assert KINDS[asked] in row["caption"] and row["clip_score"] == asked / 10
        assert row["strategy"] == "beside" and set(row) == set(arrow_schema(CONTRACT).names)


def test_beside_pairs_combine_facing_halves_of_one_split_without_held_out_pairs() -> None:
    met = {tuple(sorted(map(int, row["plan_id"].replace("plan_", "").split(" + ")))) for row in pairs()}
    assert met == {(0, 3), (1, 2), (2, 3), (4, 5)}  # cup and sun (0, 1) are held out; 4 and 5 are another split


def test_beside_pairs_are_limited_and_repeatable() -> None:
    assert len(pairs(1)) == 6
    assert pairs(2, 1) == pairs(2, 1)
    assert any(pairs(1, seed) != pairs(1, 0) for seed in range(1, 5))


def test_window_pairs_add_the_whole_thing_where_another_is_in_view() -> None:
    rows, scenes = paintings()
    found = window_pairs(rows, scenes, together=TOGETHER, number=9, seed=0)
    assert found == window_pairs(rows, scenes, together=TOGETHER, number=9, seed=0)
    in_view = 0
    for row in found:
        there, asked = (int(name.removeprefix("plan_")) for name in row["plan_id"].split(" + "))
        assert frozenset((KINDS[there], KINDS[asked])) in TOGETHER and there != asked
        assert row["split"] == rows[there]["split"] and row["caption"] == rows[asked]["caption"]
        before, after = decode_png(row["partial"]["bytes"]), decode_png(row["full"]["bytes"])
        alone = decode_png(rows[asked]["full"]["bytes"])
        assert (after == overlay(before, alone, PAPER)).all() and (after[alone < 100] < 100).all()
        in_view += bool((before < 200).any())
    assert in_view >= len(found) / 4  # a bar is thin, and may lie outside
    one_each = window_pairs(rows, scenes, together=TOGETHER, number=1, seed=0)
    assert len(one_each) == len({row["scene_id"] for row in found})


def test_overlay_shows_both_paintings_in_either_order() -> None:
    rows, _ = paintings()
    one, other = (decode_png(row["full"]["bytes"]) for row in rows[:2])
    assert (overlay(one, other, PAPER) == np.minimum(one, other)).all()
    assert (overlay(other, one, PAPER) == overlay(one, other, PAPER)).all()
    assert (overlay(one, PAPER, PAPER) == one).all()
