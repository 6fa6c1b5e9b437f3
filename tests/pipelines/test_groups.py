"""Groups of seeds: how often luck is taken for a gain, what pairing gives, and a group made by DVC."""

import os
import re
import subprocess
import sys
from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.images import encode_png
from pipelines import _seeds
from pipelines._imports import ROOT
from pipelines._params import reseeded, resolved
from pipelines._review.group_page import group_page
from pipelines._review.groups import SeedFigure, compare_groups, groups, spread, table
from pipelines._review.history import Execution, History, StageRun
from pipelines._tracking.store import store_errors
from tests.pipelines.test_queue import FILES, run

NAME = "held_out.model.mse"


class Made:
    """A history of groups `A` and `B` of one stage, from their figures by seed and the values of their items."""

    def __init__(self, a: Sequence[float], b: Sequence[float], items: dict[str, Sequence[float]] | None = None) -> None:
        self._runs: dict[str, StageRun] = {}
        self._items = items or {}
        tags = {f"items.{NAME}": "same"} if items else {}
        for group, values in (("A", a), ("B", b)):
            for seed, value in enumerate(values):
                id_, metrics = f"{group}{seed}", {NAME: value, "wall_s": 3.0, "held_out.polyline.mse": 0.4}
                self._runs[id_] = StageRun(
                    id_, "train_stroke_dynamics", "marker", "FINISHED", seed, {}, metrics, tags, {}, {}
                )
        self.executions = [
            Execution(id_, (id_,), "FINISHED", 0, {"group": f"train_stroke_dynamics · {id_[0]}", "seed": id_[1:]})
            for id_ in self._runs
        ]

    def of_execution(self, execution: Execution) -> dict[str, StageRun]:
        return {"train_stroke_dynamics@marker": self._runs[execution.name]}

    def items(self, run: StageRun, metric: str) -> Sequence[float]:
        return self._items[run.id[0]]


def compared(*made: Any) -> SeedFigure:
    history: Any = Made(*made)
    (figure,) = compare_groups(history, *groups(history))
    assert (figure.stage, figure.name, figure.main) == ("train_stroke_dynamics@marker", NAME, True)
    return figure


def test_luck_is_taken_for_a_gain_in_a_twentieth_of_the_cases() -> None:
    """A and B differ by the noise of each run alone; seeds are shared, and of any size."""
    rng, cases = np.random.default_rng(0), 2000
    wrong = 0
    for _ in range(cases):
        seeds = rng.normal(0, 1.0, 5)
        a, b = seeds + rng.normal(0, 0.1, 5), seeds + rng.normal(0, 0.1, 5)
        wrong += "beyond luck" in compared(a, b).verdict
    assert abs(wrong / cases - 0.05) < 4 * np.sqrt(0.05 * 0.95 / cases)


def test_pairing_over_seeds_finds_a_gain_below_the_spread_between_seeds() -> None:
    seeds = np.array([0.2, 0.5, 0.3, 0.9, 0.4])
    figure = compared(seeds, seeds - 0.05 + np.array([0.001, -0.002, 0.0, 0.002, -0.001]))
    assert figure.verdict == "B is better; beyond luck"
    assert figure.mean == pytest.approx(-0.05) and figure.half_width < 0.01
    assert compared(seeds, seeds).verdict == "equal"
    assert compared(seeds, seeds + 0.05).verdict == "A is better; beyond luck"
    assert "−0.05" in table([figure]) and "over 5 seeds" in table([figure])


def test_the_choice_of_held_out_items_widens_the_interval() -> None:
    """All seeds agree, yet a single item makes the gain."""
    seeds = np.full(5, 0.3) + np.arange(5) / 100
    of_items = {"A": [0.3] * 8, "B": [0.3] * 7 + [0.0]}
    alone, with_items = compared(seeds, seeds - 0.0375), compared(seeds, seeds - 0.0375, of_items)
    assert alone.verdict == "B is better; beyond luck"
    assert (with_items.verdict, with_items.items) == ("may be luck", 8)


def test_the_page_has_every_figure_with_its_interval_and_the_pictures_of_each_seed() -> None:
    rng = np.random.default_rng(0)
    pictures = {run: encode_png(rng.integers(0, 255, (6, 6, 3), dtype=np.uint8)) for run in ("A0", "B0", "A2", "B2")}
    history: Any = Made([0.3, 0.4, 0.5], [0.2, 0.3, 0.4 + 1e-3])
    history.pictures = lambda run: {"held_out.png": pictures[run.id]} if run.id in pictures else {}
    a, b = groups(history)
    found = compare_groups(history, a, b)
    page = group_page(history, a, b, found=found, changes=["No parameter differs."])
    (figure,) = found
    assert f"{NAME} (main)" in page and '<span class="sure">B is better; beyond luck</span>' in page
    assert f"[{figure.mean - figure.half_width:+.3g}".replace("-", "−") in page and "over 3 seeds" in page
    assert re.findall(r'<th scope="row">(\d)</th>', page) == ["0", "1", "2"] and "−0.099" in page
    assert re.findall(r"<summary>.*(\d)</summary>", page) == ["0", "2"] and page.count("<img ") == 2 * 3
    assert all(b64encode(png).decode() in page for png in pictures.values()) and "http" not in page


def test_one_group_shows_how_much_the_main_figure_depends_on_the_seed() -> None:
    history: Any = Made([0.2, 0.3, 0.4], [0.1])
    (group,) = (group for group in groups(history) if len(group.members) == 3)
    first, baseline = spread(history, group)
    assert first == f"train_stroke_dynamics@marker: {NAME} 0.3 ± 0.1 (0.2, 0.3, 0.4)"
    assert "held_out.polyline.mse 0.4 ± " in baseline and baseline.endswith("(0.4, 0.4, 0.4)")


def test_two_seeds_are_too_few() -> None:
    with pytest.raises(PentimentoError, match="have 2 seeds in common and 3 are needed"):
        compared([0.1, 0.2], [0.1, 0.2, 0.3])


def test_every_seed_of_a_section_moves_and_nothing_else() -> None:
    document = {
        "presets": {"pen": {"seed": 4, "width_m": 1}},
        "paint": {"planner": {"preset": "presets.pen", "width_m": 2}, "views_seed": 1, "deep": {"seed": 0}, "steps": 3},
        "deploy": {"atol": 1},
    }
    moved = reseeded(document, "paint", 10)
    expected = {"planner": {"seed": 14, "width_m": 2}, "views_seed": 11, "deep": {"seed": 10}, "steps": 3}
    assert resolved(moved)["paint"] == expected
    assert moved["presets"] == document["presets"] and resolved(reseeded(document, "paint", 0)) == resolved(document)
    with pytest.raises(ConfigError, match="deploy has no seed"):
        reseeded(document, "deploy", 1)
    with pytest.raises(ConfigError, match="no section sing"):
        reseeded(document, "sing", 1)


def test_a_group_of_runs_leaves_the_working_tree_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stage that is needed runs once; the group is complete also where DVC has a result already."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")
    monkeypatch.setenv("PENTIMENTO_PROFILE", "restored afterwards")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{ROOT / 'src'}")
    stages = "  collect: {cmd: echo x | tee -a ../../log > data.txt, params: [collect], outs: [data.txt]}\n"
    stages += "  train: {cmd: python train.py, deps: [data.txt], params: [train], outs: [metrics.json]}\n"
    files = FILES | {
        "dvc.yaml": f"stages:\n{stages}",
        "params.yaml": "collect: {seed: 3}\ntrain: {epochs: 1, seed: 7}\n",
        ".gitignore": FILES[".gitignore"] + "/.profiles/\n/log\n",
        "train.py": FILES["train.py"].replace('1 / params["epochs"]', '1 / params["seed"]'),
    }
    for name, text in files.items():
        Path(name).write_text(text)
    run("git", "init", "-q")
    run("dvc", "init", "-q")
    run("git", "add", ".")
    for _ in range(2):
        assert _seeds.main(["2", "train"]) == 0
    with store_errors():
        history = History()
        second, first = groups(history)
    assert first.stage == "train" and set(first.members) == set(second.members) == {0, 1}
    for group in (first, second):
        errors = [history.of_execution(group.members[seed])["train"].metrics["error"] for seed in (0, 1)]
        assert errors == [1 / 7, 1 / 8]
    assert len(history.runs) == 2 and {run.tags["group"] for run in history.runs} == {first.name}
    assert Path("log").read_text() == "x\n"
    assert "?? " not in subprocess.run(["git", "status", "--porcelain"], capture_output=True, text=True).stdout
    assert Path("params.yaml").read_text() == files["params.yaml"] and not Path("metrics.json").exists()


def test_what_is_no_number_of_seeds_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, sentence in (
        (["5"], "make repro SEEDS=5 STAGE="),
        ([], "make repro SEEDS=5 STAGE="),
        (["1", "train"], "make repro: SEEDS=1 is no group of seeds; give a whole number from 2 on."),
        (["many", "train"], "make repro: SEEDS=many is no group of seeds"),
    ):
        assert _seeds.main(arguments) == 2
        assert sentence in capsys.readouterr().err
