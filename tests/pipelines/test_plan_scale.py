"""Plans of many paintings from a run whose rates are known: closed forms, and what is refused."""

import argparse
import heapq
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import PentimentoError
from pipelines import plan_scale
from pipelines._imports import ROOT
from pipelines._review.scale import (
    CLUSTER,
    ON_A_CPU,
    ON_A_GPU,
    Plan,
    Rates,
    fine_tunings,
    needed_for,
    read_rates,
    shard_seconds,
    sizes_of,
)
from pipelines._review.scale_page import text
from pipelines._tracking.store import experiment_id, open_store, store_errors
from pipelines._tracking.timings import TIMINGS, write_timing
from tests.pipelines.conftest import Enter

SYNTHESIS, SHARD_S, WALL_S = "synthesize_copaintings@marker", 10.0, 47.0
BEGAN_S = 1000.0
# Two workers begin 12 and 14 s after the stage; the pairs are kept in 3 s.
ENDS_S = (22.0, 24.0, 32.0, 34.0, 42.0, 44.0)
PARAMS = {
    "workers": 2, "scheduler": None, "setting.strokes": 50, "setting.canvas_m": (0.06, 0.06), "setting.picture_px": 64,
    "setting.planner.pixels_per_m": 1600.0, "setting.planner.rounds": 3, "setting.planner.iterations_per_round": 8,
    "setting.planner.iterations_free": 80, "setting.planner.iterations_palette": 0, "setting.guidance.iterations": 20,
}  # fmt: skip
LOCK = """\
stages:
  build_scenes: {outs: [{path: data/scenes}]}
  synthesize_copaintings@marker: {deps: [{path: data/scenes}], outs: [{path: data/copaintings/marker}]}
  finetune_goal_planner: {deps: [{path: data/copaintings/marker}], outs: [{path: models/goal}]}
  evaluate_copainting@marker: {deps: [{path: models/goal}, {path: pipelines/x.py}], outs: [{path: data/evaluation}]}
  sculpt@foam: {outs: [{path: data/sculptures}]}
"""


def record(params: dict[str, Any], ends_s: tuple[float, ...] = ENDS_S) -> None:
    """A run of the stage in MLflow's store, and its timing."""
    client = open_store()
    run = client.create_run(experiment_id(client, "pentimento/co-painting"), start_time=0).info.run_id
    for name, value in params.items():
        client.log_param(run, name, value)
    for name, value in {"scenes": 12, "pairs": 100}.items():
        client.log_metric(run, name, value)
    client.log_metric(run, "shards", 0, timestamp=500_000)  # of an attempt that was interrupted
    for number, end_s in enumerate(ends_s):
        client.log_metric(run, "shards", number + 1, timestamp=int(1000 * (BEGAN_S + end_s)), step=number + 1)
    client.set_terminated(run, "FINISHED", end_time=int(1000 * (BEGAN_S + WALL_S)))
    write_timing(SYNTHESIS, run, WALL_S)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory, enter: Enter) -> Iterator[Path]:
    """Six shards of two paintings each, 10 s of a worker each, and 100 pairs of 40 bytes."""
    folder = tmp_path_factory.mktemp("repository")
    with pytest.MonkeyPatch.context() as patch:
        enter(folder, patch)
        Path("dvc.lock").write_text(LOCK)
        for name, seconds in (("build_scenes", 20.0), ("evaluate_copainting@marker", 200.0), ("sculpt@foam", 1e6)):
            write_timing(name, "1234567890", seconds)
        kept = Path("data/copaintings/marker")
        kept.mkdir(parents=True)
        (kept / "metrics.json").write_text('{"pairs": 100}')
        (kept / "part-00000.parquet").write_bytes(bytes(4000))
        CLUSTER.parent.mkdir(parents=True)
        CLUSTER.write_text(
            json.dumps(
                {
                    "finished": "2026-01-31 12:00:00",
                    "measured": [
                        {"workers": 1, "plain_s": 10.0, "cluster_s": 9.9},
                        {"workers": 2, "plain_s": 5.0, "cluster_s": 5.5},
                    ],
                }
            )
        )
        with store_errors():
            record(PARAMS)
        yield folder


@pytest.fixture
def rates(store: Path) -> Rates:
    with store_errors():
        return read_rates(Path(), "marker")


def plan_of(rates: Rates, **changes: Any) -> Plan:
    plain = Plan(rates, paintings=1200, machines=8, cores=4, price=None, sizes=rates.sizes, profile=None)
    return replace(plain, **changes)


def test_rates_are_those_of_the_run(rates: Rates) -> None:
    assert rates.shards_s == pytest.approx([SHARD_S] * 4)
    assert (rates.begin_s, rates.end_s) == pytest.approx((WALL_S - 3 - 6 * SHARD_S / 2, 3.0))
    assert (rates.paintings, rates.pairs, rates.bytes) == (12, 100, 4000)
    assert rates.sizes == sizes_of(as_written())
    assert rates.sizes.pixels == 96**2 and rates.sizes.iterations == 80 + 20 + 3 * 8 / 4
    assert [timing.name for timing in rates.serial] == ["build_scenes", "evaluate_copainting@marker"]
    assert rates.overhead.share == pytest.approx(0.1) and rates.overhead.workers == 2


def as_written() -> dict[str, Any]:
    """The same setting as params.yaml says it."""
    plain = {name.removeprefix("setting."): value for name, value in PARAMS.items()}
    return plain | {"canvas_m": ["60 mm", "60 mm"]}


def test_one_machine_takes_the_measured_rate_times_the_paintings(rates: Rates) -> None:
    plan = plan_of(rates, cores=1)
    a_painting = SHARD_S * 6 / 12
    assert plan.painting_s() == pytest.approx((a_painting,) * 3)
    assert plan.sharded_s(1) == pytest.approx((1200 * a_painting,) * 3)
    rest = rates.begin_s + 3.0 * 1200 / 12 + 20 + 200
    assert plan.serial_s() == pytest.approx(rest)
    assert plan.wall_s(1).mean == pytest.approx(1200 * a_painting + rest)
    assert plan_of(rates, cores=1, paintings=12, machines=1).keeping_s() == pytest.approx(rates.end_s)  # as it was run


def test_twice_the_machines_halve_what_shards_and_nothing_else(rates: Rates) -> None:
    plan = plan_of(rates)
    for machines in (2, 4, 64):
        assert plan.sharded_s(2 * machines) == pytest.approx([s / 2 for s in plan.sharded_s(machines)])
        saved = plan.wall_s(machines).mean - plan.wall_s(2 * machines).mean
        assert saved == pytest.approx(plan.sharded_s(machines).mean / 2)
    assert plan.sharded_s(2).mean == pytest.approx(1.1 * plan.sharded_s(1).mean / 2)  # a cluster has its overhead
    assert plan.speed_up(10**9) == pytest.approx(plan.wall_s(1).mean / plan.serial_s(), rel=1e-6)


def test_the_price_is_that_of_the_hours_of_all_machines(rates: Rates) -> None:
    plan = plan_of(rates, price=3600.0)  # 1 a second
    assert plan.cost(1).mean == pytest.approx(plan.wall_s(1).mean)
    assert plan.cost(8).mean == pytest.approx(8 * plan.sharded_s(8).mean + plan.serial_s())
    assert plan.cost(8) == pytest.approx(plan.cost(64))  # what is shared costs the same


def test_sizes_multiply_time_and_bytes(rates: Rates) -> None:
    larger = replace(rates.sizes, strokes=100, pixels=4 * rates.sizes.pixels, picture_pixels=128**2)
    plain, scaled = plan_of(rates), plan_of(rates, sizes=larger)
    assert scaled.core_s().mean == pytest.approx(8 * plain.core_s().mean)
    assert plain.kept_bytes() == pytest.approx(40 * 100 / 12 * 1200)
    assert scaled.kept_bytes() == pytest.approx(4 * plain.kept_bytes())
    assert scaled.memory_bytes() == pytest.approx(100 / 12 * 1200 * 2 * 3 * 128**2)


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_shards_of_workers_that_never_wait_are_timed(workers: int) -> None:
    """Of shards of any lengths the mean is found, and the shortest and longest twentieth nearly."""
    lengths = np.random.default_rng(workers).uniform(8.0, 12.0, 400)
    free = [0.0] * workers
    ends = []
    for length in lengths:
        ends.append(heapq.heappop(free) + float(length))
        heapq.heappush(free, ends[-1])
    found = shard_seconds(sorted(ends), workers)
    assert np.mean(found) == pytest.approx(lengths.mean(), rel=0.01)
    assert np.quantile(found, [0.05, 0.95]) == pytest.approx(np.quantile(lengths, [0.05, 0.95]), rel=0.1)


def test_what_a_setting_needs_is_read_off_the_lock() -> None:
    stages = {
        "a": {"outs": [{"path": "x"}]},
        "synthesize_copaintings@pen": {"deps": [{"path": "x"}], "outs": [{"path": "y"}]},
        "other": {"deps": [{"path": "y"}]},
    }
    assert needed_for(stages, "pen") == ["a"]  # which is not evaluated


def ask(**options: Any) -> None:
    given = {"paintings": 20000, "machines": 8, "cores": 4, "price": None, "setting": "marker", "profile": None}
    plan_scale.main(argparse.Namespace(**(given | {"out": Path("data/scale")} | options)))


def test_the_page_needs_nothing_else_and_says_where_its_figures_come_from(
    store: Path, rates: Rates, capsys: pytest.CaptureFixture[str]
) -> None:
    ask(price=0.5)
    said, page = capsys.readouterr().out, Path("data/scale/index.html").read_text()
    assert said.startswith("20,000 co-paintings on 8 machines of 4 cores: ")
    for told in (rates.timing.run[:8], str(CLUSTER), "evaluate_copainting@marker", "assumed"):
        assert told in said and told in page
    assert "sculpt" not in said  # nothing waits for it
    assert "http" not in page and "<script" not in page


def test_the_sizes_of_a_profile_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    sizes = plan_scale.sizes_in("full", "marker")
    assert (sizes.strokes, sizes.pixels, sizes.picture_pixels) == (200, 512**2, 512**2)


TUNING = {"steps": 300, "batch": 4, "lora": None, "precision": "bf16-mixed", "gradient_checkpointing": True}
ROW = {"side_px": 512, "batch": 16, "precision": "bf16-mixed", "lora": None, "step_s": 0.25, "peak_gb": 40.0}


def test_fine_tuning_is_planned_from_the_measured_steps_alone(tmp_path: Path) -> None:
    assert fine_tunings(tmp_path, TUNING) == ()
    (tmp_path / ON_A_CPU).mkdir(parents=True)
    (tmp_path / ON_A_CPU / "whole.json").write_text('{"step_cpu_s": 50.0, "peak_gb": 16.0}')
    others = [{"side_px": 256}, {"batch": 2}, {"precision": "32-true"}, {"lora": 8}]
    (tmp_path / ON_A_GPU).write_text(json.dumps({"trainings": [*(ROW | other for other in others), ROW]}))
    cpu, gpu = fine_tunings(tmp_path, TUNING)
    assert (cpu.seconds, cpu.memory_bytes) == (300 * 4 * 50.0, 16e9)
    assert (gpu.seconds, gpu.memory_bytes) == (pytest.approx(300 * 0.25 * 4 / 3), 40e9)
    (only,) = fine_tunings(tmp_path, TUNING | {"lora": {"rank": 8, "alpha": 8}, "gradient_checkpointing": False})
    assert only.seconds == pytest.approx(300 * 0.25)  # of low-rank updates the CPU's step is missing


def test_a_profile_of_the_published_size_says_what_fine_tuning_takes(
    rates: Rates, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    sizes = plan_scale.sizes_in("full", "marker")
    assert plan_scale.fine_tunings_in("full", sizes) is not None
    assert plan_scale.fine_tunings_in("quick", sizes) is None
    said = text(plan_of(rates, sizes=sizes, profile="full", fine_tunings=()))
    assert "run `python -m studies.on_a_gpu`" in said and "run `python -m studies.published_sizes`" in said
    assert "Fine-tuning" not in text(plan_of(rates))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            {"setting": "colour4"},
            r"No rates were measured yet: data/timings has no synthesize_copaintings@colour4\.json",
        ),
        ({"machines": 0}, r"--machines is 0; give 1 or more"),
    ],
)
def test_what_was_not_measured_or_makes_no_sense_is_refused(
    store: Path, options: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(PentimentoError, match=sentence):
        ask(**options)


def test_without_the_cluster_s_overhead_it_is_refused(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipelines._review.scale.CLUSTER", Path("data/studies/none.json"))
    with pytest.raises(PentimentoError, match=r"none\.json does not exist; run `python -m studies\.cluster`"):
        ask()


@pytest.mark.parametrize(
    ("params", "ends_s", "kept", "sentence"),
    [
        ({"scheduler": "tcp://host:8786"}, ENDS_S, 100, "painted on the workers of tcp://host:8786"),
        ({}, ENDS_S[:5], 100, "painted 5 shards with 2 workers, too few"),
        ({}, ENDS_S, 99, "holds 99 pairs, but run .* kept 100"),
    ],
)
def test_a_run_that_tells_no_rate_is_refused(
    store: Path, params: dict[str, Any], ends_s: tuple[float, ...], kept: int, sentence: str
) -> None:
    timing, metrics = TIMINGS / f"{SYNTHESIS}.json", Path("data/copaintings/marker/metrics.json")
    before = timing.read_bytes(), metrics.read_bytes()
    metrics.write_text(json.dumps({"pairs": kept}))
    with store_errors():
        record(PARAMS | params, ends_s)
    try:
        with pytest.raises(PentimentoError, match=sentence):
            ask()
    finally:
        timing.write_bytes(before[0])
        metrics.write_bytes(before[1])
