"""The comparison of stroke models: dataset B's hands, splits, intervals, resuming, numbers on the page."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pentimento.contracts.strokes import example_table
from studies.stroke_models import compare as comparing
from studies.stroke_models.candidates import ANALYTIC, NAMES
from studies.stroke_models.compare import Results, compare, read_results
from studies.stroke_models.hands import HANDS, hand_stroke
from studies.stroke_models.measured import BRUSHES, LIKE, PENS, held_out_of
from studies.stroke_models.page import own_table, whole
from studies.stroke_models.statistics import estimate, ratio


@pytest.mark.parametrize("hand", HANDS)
def test_a_hand_keeps_to_its_box_and_to_the_tool(hand: str) -> None:
    stroke = hand_stroke(hand, np.random.default_rng(3), 0.04, (3e-4, 4e-3), 32)
    x, y, z, _ = stroke.T
    assert stroke.shape == (32, 4)
    assert max(np.ptp(x), np.ptp(y)) <= 0.04 + 1e-9
    assert max(np.ptp(x), np.ptp(y)) > 0.03  # corners may fall between points
    assert abs(x.min() + x.max()) < 0.01
    assert ((-z >= 3e-4) & (-z <= 4e-3)).all()
    assert np.ptp(z) > 1e-3
    again = hand_stroke(hand, np.random.default_rng(3), 0.04, (3e-4, 4e-3), 32)
    np.testing.assert_array_equal(stroke, again)


def test_hands_turn_more_than_a_bezier_stroke_does() -> None:
    """Out of distribution: the designed strokes turn by less than half a circle in all."""
    for hand in HANDS:
        turned = []
        for seed in range(10):
            x, y = hand_stroke(hand, np.random.default_rng(seed), 0.04, (0.0, 1e-3), 64)[:, :2].T
            heading = np.unwrap(np.arctan2(np.diff(y), np.diff(x)))
            turned.append(np.abs(np.diff(heading)).sum())
        assert np.median(turned) > np.pi, hand


def test_repeats_of_an_action_are_held_out_together() -> None:
    action = np.repeat(np.arange(20), 3)
    table = pa.table({"action_id": action, "row": np.arange(60)})
    training, held_out = held_out_of(table, 1)
    assert training.num_rows + held_out.num_rows == 60
    assert held_out.num_rows == 15
    assert not set(training["action_id"].to_pylist()) & set(held_out["action_id"].to_pylist())


def test_four_quarters_hold_out_each_action_once() -> None:
    table = pa.table({"action_id": np.arange(42)})
    held_out = [held_out_of(table, number)[1]["action_id"].to_pylist() for number in range(8)]
    for first in (0, 4):
        assert sorted(action for part in held_out[first : first + 4] for action in part) == list(range(42))
    assert sorted(held_out[0]) != sorted(held_out[4])


def test_every_set_has_another_to_be_tested_on() -> None:
    assert len(BRUSHES) == 8
    assert set(LIKE) == {*BRUSHES, *PENS}
    for name, other in LIKE.items():
        assert other != name
        assert (other in BRUSHES) == (name in BRUSHES)


def _run(l1: dict[str, float], iou: dict[str, float], tests: tuple[str, ...], spread: float = 0.0) -> Results:
    noise = spread * np.random.default_rng(0).standard_normal(40)
    return {
        name: {
            "train_s": 20.0, "render_ms": 2.0, "strokes": 160,
            "said": {"established": ["bristle_lag"], "kept": ["bristle_lag"], "diagnosing_s": 5.0}
            if name == "mechanisms" else {},
            "scores": {t: {"l1": (l1[name] + noise).tolist(), "iou": (iou[name] + noise).tolist()} for t in tests},
        }
        for name in l1
    }  # fmt: skip


def test_intervals_hold_the_mean_and_ratios_use_the_same_strokes() -> None:
    run = _run({"cnn": 0.04, "traj2stroke": 0.02}, {"cnn": 0.5, "traj2stroke": 0.7}, ("B",), spread=0.002)
    found = estimate([run, run], "cnn", "B", "l1")
    assert found.low < found.value < found.high
    assert found.high - found.low == pytest.approx(2 * 1.96 * 0.002 / np.sqrt(80), rel=0.35)
    pairs = ratio([run], "traj2stroke", "cnn", "B", "l1")
    assert pairs.value == pytest.approx(0.5, abs=0.01)
    # Drawn apart, noise of 5 % and 10 % a stroke would spread it three times as wide.
    assert pairs.high - pairs.low < 0.015


def test_a_stroke_without_ink_has_no_iou() -> None:
    run = _run({"cnn": 0.04}, {"cnn": 0.5}, ("B",))
    run["cnn"]["scores"]["B"]["iou"][:20] = [float("nan")] * 20
    assert estimate([run], "cnn", "B", "iou").value == pytest.approx(0.5)


def test_page_states_which_targets_are_met() -> None:
    l1 = {name: 0.05 - 0.002 * place for place, name in enumerate(NAMES)} | {"traj2stroke": 0.02, "mechanisms": 0.01}
    iou = {name: 0.4 + 0.01 * place for place, name in enumerate(NAMES)}
    run = _run(l1, iou, ("A", "B"))
    measured = {name: [_run(l1, iou, ("own", "other"))] * 2 for name in (*BRUSHES, *PENS)}
    worse = _run(l1, dict(iou, mechanisms=0.1), ("own", "other"))
    measured["brush_2022a"] = measured["marker_6x6"] = [measured["brush_2022a"][0], worse]
    said = whole({"marker": {1: run}, "round_brush": {1: run}}, measured, {"marker": {10: run, 440: run}})
    met = "0.50 (0.50 to 0.50), target ≤ {} (met)"
    assert f"divided by that of the better CNN (CNN with CoordConv): {met.format(0.6)}" in said
    assert f"divided by that of the best of the thesis's models (Traj2Stroke): {met.format(0.75)}" in said
    for better, sets in (("mechanisms", 7), ("mechanisms + correction", 8)):
        won = f"{better} has a better IoU than all other rows on {sets} of 8 brush sets, target 6 of 8 (met)"
        assert said.count(f"Traj2Stroke + {won}") == 2
    assert (
        said.count("the polyline has a better IoU than Traj2Stroke + mechanisms on 1 of 4 sets, target 0 (not met)")
        == 2
    )
    assert "| 440 |" in said
    assert "`bristle_lag`" in said
    assert "nan" not in said
    slow = _run(l1, iou, ("own",))
    slow["cnn"]["train_s"] = 99.0
    own = own_table([slow], "mine.parquet", 40)
    assert "took 99 s, target ≤ 60 (not met)" in own
    assert "The lowest L1 is that of **Traj2Stroke + mechanisms**" in own


def test_a_page_of_what_there_is_so_far() -> None:
    part = _run({"polyline": 0.05, "traj2stroke": 0.02}, {"polyline": 0.5, "traj2stroke": 0.6}, ("own", "other"))
    said = whole({"marker": {}, "round_brush": {}}, {"brush_2022b": [part]}, {})
    assert "| brush_2022b | held out | 0.500 | **0.600** |" in said
    assert "target" not in said


def test_what_is_done_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = example_table(24)
    tests = {"own": table.slice(16)}
    first = compare(table.slice(0, 16), tests, ANALYTIC, tmp_path, ("blank", "polyline"))
    assert set(first) == {"blank", "polyline"}
    assert len(first["polyline"]["scores"]["own"]["l1"]) == 8
    assert np.mean(first["polyline"]["scores"]["own"]["l1"]) < np.mean(first["blank"]["scores"]["own"]["l1"])
    assert np.load(tmp_path / "polyline.npz")["own"].dtype == np.uint8
    (tmp_path / "blank.json").write_text(json.dumps(first["blank"] | {"said": {"kept": "as it was"}}))

    def never(*_: object) -> None:
        raise AssertionError("it trains again")

    monkeypatch.setattr(comparing, "Training", never)
    again = compare(table.slice(0, 16), tests, ANALYTIC, tmp_path, ("blank", "polyline"))
    assert again["blank"]["said"] == {"kept": "as it was"}
    assert again == read_results(tmp_path)
