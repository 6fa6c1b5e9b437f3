"""Chamfer distance between height maps: closed forms, and its blindness to thin lines; and what the page says."""

import argparse
import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.images import read_image, write_png
from pentimento.planning.objectives import ClayObjective, Weights
from studies.sculpting import page, rims
from studies.sculpting.chamfer import ChamferObjective
from studies.sculpting.shapes import face, knot

WINDOW_M = (0.0, 0.0, 0.064, 0.064)
FLAT = np.full((64, 64), 0.0402, np.float32)


def test_a_map_is_at_no_distance_from_itself() -> None:
    rough = FLAT + np.random.default_rng(0).normal(0, 1e-3, FLAT.shape).astype(np.float32)
    assert float(ChamferObjective(rough, WINDOW_M, 0.004).values(rough)) == 0.0


def test_a_raised_plane_is_as_far_as_it_is_raised() -> None:
    chamfer = ChamferObjective(FLAT, WINDOW_M, 0.004)
    assert float(chamfer.values(FLAT + np.float32(0.0015))) == pytest.approx(1.5**2, rel=1e-3)


def test_many_maps_have_the_distances_of_each() -> None:
    chamfer = ChamferObjective(FLAT, WINDOW_M, 0.004)
    maps = np.stack([FLAT, FLAT + np.float32(0.001)])
    np.testing.assert_allclose(chamfer.values(maps), [float(chamfer.values(each)) for each in maps])


def test_a_line_is_less_to_it_than_a_shift_and_more_to_the_eye() -> None:
    line = FLAT.copy()
    line[32] -= 0.002
    shifted = FLAT + np.float32(0.0006)
    chamfer, eye = ChamferObjective(FLAT, WINDOW_M, 0.004), ClayObjective(FLAT, WINDOW_M, Weights(0.0, 1.0))
    assert float(chamfer.values(line)) < float(chamfer.values(shifted))
    assert float(eye.values(line)) > 100 * float(eye.values(shifted))


def test_the_page_says_where_acting_becomes_worse_than_not_acting(tmp_path: Path) -> None:
    levels = [
        {"level": level, "noise_mm2": noise, "error_3d_mm2": height, "visual_error": slope}
        for level, noise, height, slope in ((0.0, 0.0, 0.2, 0.1), (2.0, 0.4, 3.0, 0.4), (1.0, 0.2, 1.0, 0.3))
    ]
    nothing = {"error_3d_mm2": 2.0, "visual_error": 0.2}
    said = {"material": "foam", "actions": 40, "draws": 6, "nothing": nothing, "levels": levels}
    (tmp_path / "noise.json").write_text(json.dumps(said))
    page.main(argparse.Namespace(results=tmp_path, out=tmp_path / "docs"))
    text = " ".join((tmp_path / "docs/sculpting.md").read_text().split())
    assert "0.100 mm² in slope and 0.300 mm² in height" in text  # halfway between two levels each
    assert (tmp_path / "docs/sculpting/noise.png").exists() and "alphabet" not in text


def test_the_page_counts_letters_that_met_their_bar_and_were_read(tmp_path: Path) -> None:
    folder = tmp_path / "alphabet_foam_1"
    folder.mkdir()
    for number, (letter, removed, read) in enumerate((("A", 0.9, "A"), ("B", 0.5, "B"), ("C", 0.7, "G"))):
        error = {"before": 1.0, "after": 1 - removed, "removed": removed}
        said = {
            "letter": letter, "reach_m": 0.002, "actions": [[0.1, 0.1, 0, 0.02, 0.004]], "error_3d_mm2": error,
            "visual_error": error, "read": {"clay": read, "probability": 0.8},
        }  # fmt: skip
        (folder / f"{number}_{letter}.json").write_text(json.dumps(said))
        write_png(folder / f"{number}_{letter}.png", np.full((8, 16, 3), 100, np.uint8))
    page.main(argparse.Namespace(results=tmp_path, out=tmp_path / "docs"))
    text = " ".join((tmp_path / "docs/sculpting.md").read_text().split())
    assert "60 % or more for 2 of 3 letters; 2 of 3 are classified correctly" in text
    assert read_image(tmp_path / "docs/sculpting/alphabet_foam.png").shape == (8, 16, 3)


def test_a_face_is_alike_on_both_sides_and_a_knot_turns_by_a_third() -> None:
    relief, woven = face(64), knot(65)
    np.testing.assert_allclose(relief, relief[:, ::-1], atol=1e-12)
    assert relief.min() == -1.0 and relief.max() == 0.0 and relief[0, 0] == 0.0
    assert woven.min() == -1.0 and woven[32, 32] == 0.0  # nothing passes the middle
    x, y = (np.arange(65) + 0.5) / 65 * 2 - 1, (np.arange(65) + 0.5) / 65 * 2 - 1
    places = np.stack(np.meshgrid(x, -y), axis=-1)
    third = np.array([[-0.5, -np.sqrt(0.75)], [np.sqrt(0.75), -0.5]])
    turned = places @ third
    column, row = (np.rint((turned[..., 0] + 1) * 32.5 - 0.5), np.rint((1 - turned[..., 1]) * 32.5 - 0.5))
    inside = np.hypot(places[..., 0], places[..., 1]) < 0.9
    difference = woven[row[inside].astype(int), column[inside].astype(int)] - woven[inside]
    assert np.abs(difference).mean() < 0.05


def test_the_page_states_what_a_relief_removed(tmp_path: Path) -> None:
    said = {
        "goal": "knot", "seed": 1, "side_px": 512, "grid": [128, 128], "actions": [[0.1, 0.1, 0, 0.02, 0.004]] * 3,
        "error_3d_mm2": [4.0, 1.0], "visual_error": [0.2, 0.1], "visual_error_on_grid": [0.2, 0.05], "values": [2, 1],
        "noise_of_a_scan": {"error_3d_mm2": 0.01, "visual_error": 0.05},
        "plans": {"wall_s": 61.4, "cpu_s": 29.6, "plans": 38},
    }  # fmt: skip
    (tmp_path / "reliefs_knot.json").write_text(json.dumps(said))
    write_png(tmp_path / "reliefs_knot.png", np.full((512, 1536, 3), 100, np.uint8))
    page.main(argparse.Namespace(results=tmp_path, out=tmp_path / "docs"))
    text = " ".join((tmp_path / "docs/sculpting.md").read_text().split())
    assert "| knot | 1 | 3 | 4.00 | 1.00 | 75 % | 50 % | 25 % | 67 % | 75 % | 30 s |" in text  # (.2 - .1) / (.2 - .05)
    assert read_image(tmp_path / "docs/sculpting/reliefs.png").shape == (320, 960, 3)


def test_the_page_says_what_pellets_gain_with_its_interval(tmp_path: Path) -> None:
    runs = [
        {
            "seed": seed,
            "push": {"error_3d_mm2": [1.0, 1.0], "visual_error": [0.2, 0.2], "pellets": 0, "pushes": 0},
            "place and push": {"error_3d_mm2": [1.0, left], "visual_error": [0.2, 0.1], "pellets": 12, "pushes": 3},
        }
        for seed, left in ((1, 0.2), (2, 0.4))
    ]
    said = {
        "material": "foam", "actions": 24, "pixels": 64, "pellets": 24, "raised_m": 0.004, "sunken_m": 0.0035,
        "model": {"kept": 0.56, "unexplained": 0.08}, "goals": {"a dome": {"raised": True, "runs": runs}},
    }  # fmt: skip
    (tmp_path / "places_foam.json").write_text(json.dumps(said))
    write_png(tmp_path / "places_foam.png", np.full((8, 16, 3), 100, np.uint8))
    page.main(argparse.Namespace(results=tmp_path, out=tmp_path / "docs"))
    text = (tmp_path / "docs/sculpting.md").read_text().replace("\u00a0", " ")
    # Two values 0.2 apart: a standard error of 0.1, times t(0.975, 1) = 12.706.
    assert "| a dome | 0.0 % ± 0.0 % | 70 % ± 127 % | 70 % ± 127 % | 0.0 % ± 0.0 % | 50 % ± 0.0 % | 12.0 |" in text
    assert (tmp_path / "docs/sculpting/places_foam.png").is_file()


@pytest.mark.parametrize("name", rims.GOALS)
def test_a_goal_without_added_material_has_the_volume_of_the_clay(name: str) -> None:
    goal = rims.GOALS[name]
    relief = rims.relief_m(goal, FLAT.shape)
    extreme = relief.max() if goal.height_m > 0 else relief.min()
    assert extreme == pytest.approx(goal.height_m, rel=0.05)
    rough = FLAT + np.random.default_rng(0).normal(0, 1e-3, FLAT.shape).astype(np.float32)
    made = rims.goal_m(relief, rough, 0.1)
    assert float(made.mean(dtype=np.float64)) == pytest.approx(float(rough.mean(dtype=np.float64)), abs=1e-8)
    np.testing.assert_array_equal(made[:6], rough[:6])  # the border
    inner = (slice(6, -6), slice(6, -6))
    np.testing.assert_allclose(np.ptp(made[inner] - relief[inner]), 0.0, atol=1e-8)


def test_the_page_says_where_pinches_are_better(tmp_path: Path) -> None:
    folder = tmp_path / "rims_dough"
    folder.mkdir()
    write_png(folder / "rims.png", np.full((8, 16, 3), 100, np.uint8))
    for goal in rims.GOALS:
        for seed, offset in ((1, 0.0), (2, 0.001)):
            left = {"push": 0.5, "pinch": 0.3 if goal == "ridge" else 0.7, "both": 0.4}
            for arm, share in left.items():
                said = {
                    "goal": goal, "arm": arm, "seed": seed, "error_3d_mm2": [1.0, share + offset],
                    "visual_error": [0.2, 0.2 + offset * (1 if arm == "push" else -1)], "rise_mm": [2.0, 1.0],
                    "tools": ["ball", "gripper"] if arm == "both" else ["ball"],
                }  # fmt: skip
                (folder / f"{goal}_{arm}_{seed}.json").write_text(json.dumps(said))
    page.main(argparse.Namespace(results=tmp_path, out=tmp_path / "docs"))
    text = (tmp_path / "docs/sculpting.md").read_text().replace("\u00a0", " ")
    others = ", ".join(goal for goal in rims.GOALS if goal != "ridge")
    assert f"- height: pinches: ridge; pushes: {others}; neither: none" in text
    assert f"- slope: pinches: none; pushes: none; neither: {', '.join(rims.GOALS)}" in text
    assert "50 % of its actions are pinches" in text.replace("\n", " ")
    assert (tmp_path / "docs/sculpting/rims_dough.png").is_file()


def test_the_page_states_coverage_gains_and_crossings(tmp_path: Path) -> None:
    kinds = {
        kind: {
            "coverage": [0.87, 0.91],
            "coverage_where_expected": [0.9, 0.92],
            "coverage_where_it_moved": [0.84, 0.9],
            "width_mm": 0.5,
            "score_mm": score,
        }
        for kind, score in (("as fitted", 0.7), ("of one width", 0.9))
    }
    intervals = {"one": kinds | {"spread_alone": 0.0, "spread_mm2": 0.0, "residual_mm2": 0.04}}
    sculptures = [
        {"arm": arm, "seed": seed, "goal": "letter:A", "actions": 20} | {
            name: [2.0, left] for name in ("error_3d_mm2", "visual_error", "value")
        }
        for arm, left in (("one network", 1.0), ("one, unexplained", 0.8)) for seed in (1, 2)
    ]  # fmt: skip
    errors = ("error_3d_mm2", "visual_error", "visual_error_at_4_mm")
    actions = [
        {"seed": 1, "level": level, "plan": plan, "noise_mm2": noise, "nothing": dict.fromkeys(errors, 1.0),
         "errors": dict.fromkeys(errors, share)}
        for level, noise, *shares in ((0.0, 0.0, 0.4, 0.4), (1.0, 0.2, 0.8, 0.7), (2.0, 0.4, 1.2, 0.9))
        for plan, share in zip(("plain", "noise known"), shares, strict=True)
    ]  # fmt: skip
    arm = {"scale_m": 0.004, "errors": dict.fromkeys(errors, 0.5)}
    scans = [{"seed": seed, "noise_m": 1e-4, "nothing": dict.fromkeys(errors, 1.0), "plain": arm, "at a scale": arm}
             for seed in (1, 2)]  # fmt: skip
    said = {"material": "foam", "pushes": 24, "draws": 6, "intervals": intervals, "sculptures": sculptures,
            "actions": actions, "scans": scans}  # fmt: skip
    (tmp_path / "uncertainty_foam.json").write_text(json.dumps(said))
    page.main(argparse.Namespace(results=tmp_path, out=tmp_path / "docs"))
    text = (tmp_path / "docs/sculpting.md").read_text().replace("\u00a0", " ")
    assert (
        "| one network | 87 % to 91 % | 90 % to 92 % | 84 % to 90 % | 0.500 mm | 0.700 mm | 87 % to 91 % | 0.900 mm |"
        in text
    )
    assert "| one, unexplained | 40 % | 40 % | 40 % | 40 % | 40 % | 40 % | 10 % ± 0.0 % | 20.0 |" in text
    assert (
        "| plain | 40 % | 80 % | 0.300 | 40 % | 80 % | 0.300 | 40 % | 80 % | 0.300 |" in text
    )  # halfway between two levels
    assert "| noise known | 40 % | 70 % | none up to 0.400 |" in text
    assert "| 0.1 mm | 4.00 mm | 50 % | 50 % | 0.0 % ± 0.0 % |" in text
