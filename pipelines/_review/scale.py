"""Time, price and bytes of many co-paintings on several machines.

The rates are those that this checkout measured: from MLflow, data/timings/, the outputs and `studies.cluster`. A plan
extrapolates them by Amdahl's law.
"""

import json
from ast import literal_eval
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.units import parse_quantity
from pipelines._tracking.dvc_files import locked_stages
from pipelines._tracking.store import open_store
from pipelines._tracking.timings import TIMINGS

CLUSTER = Path("data/studies/cluster.json")
ON_A_GPU = Path("data/studies/on_a_gpu.json")
ON_A_CPU = Path("data/studies/published_sizes")
PUBLISHED_PX = 512
"""Side of a picture in the steps of these two studies that a plan uses."""
_RECOMPUTED = 4 / 3  # time of a step with gradient checkpointing, of one without
STAGE = "synthesize_copaintings"
_MIN_SHARDS = 4  # after the first of each worker, for a spread


class Timing(NamedTuple):
    """Duration of a stage item's last run."""

    name: str
    seconds: float
    finished: str
    run: str


class Overhead(NamedTuple):
    """Additional time of a cluster relative to plain processes."""

    share: float
    workers: int
    """Of the measurement with the largest share."""
    finished: str


@dataclass(frozen=True)
class Sizes:
    """Sizes that determine the time of one painting and the bytes of its pictures."""

    strokes: int
    pixels: int
    """Of the picture that is planned with."""
    iterations: float
    """Equivalent at full resolution: those of a round are at half of it, and count a quarter."""
    picture_pixels: int


@dataclass(frozen=True)
class Rates:
    """Measured rates of one run of synthesize_copaintings, and of the stages that cannot be sharded."""

    timing: Timing
    workers: int
    paintings: int
    shards: int
    shards_s: tuple[float, ...]
    """Seconds of one worker for each shard, without the first shard of each worker, which loads and compiles."""
    begin_s: float
    """Of the stage before its workers paint."""
    end_s: float
    """Of the stage after the last shard: scoring and keeping of all pairs."""
    sizes: Sizes
    pairs: int
    bytes: int
    """Of the pairs' shards, as they are kept."""
    serial: tuple[Timing, ...]
    """Stages that do not shard: the evaluation of these paintings and all others that it needs."""
    overhead: Overhead

    def painting_s(self, shard_s: float) -> float:
        """Seconds of one core for a painting, where a shard takes `shard_s`."""
        return shard_s * self.shards / self.paintings


def read_rates(folder: Path, setting: str) -> Rates:
    """Return the rates measured in a checkout; call inside `store_errors`.

    Raises:
        PentimentoError: a measurement is missing, or the outputs are those of another run.
    """
    name = f"{STAGE}@{setting}"
    timings = read_timings(folder)
    if name not in timings:
        raise PentimentoError(
            f"No rates were measured yet: {folder / TIMINGS} has no {name}.json; run `make repro`, which paints and "
            "times some hundred paintings."
        )
    overhead = read_overhead(folder / CLUSTER)
    timing = timings[name]
    client = open_store()
    stored = client.get_run(timing.run)
    params, metrics = stored.data.params, stored.data.metrics
    if params["scheduler"] != "None":
        raise PentimentoError(
            f"Run {timing.run[:8]} painted on the workers of {params['scheduler']}, whose number is not known; set "
            f"{STAGE}.scheduler to null and run once more."
        )
    ended_ms = int(stored.info.end_time or 0)
    began_ms = ended_ms - 1000 * timing.seconds  # shards of an interrupted attempt are not timed
    times_s = sorted(
        point.timestamp / 1000 for point in client.get_metric_history(timing.run, "shards")
        if point.timestamp >= began_ms
    )  # fmt: skip
    workers = min(int(params["workers"]), max(len(times_s), 1))
    shards_s = shard_seconds(times_s, workers)
    if len(shards_s) < _MIN_SHARDS:
        raise PentimentoError(
            f"Run {timing.run[:8]} painted {len(times_s)} shards with {workers} workers, too few for a rate; raise "
            f"{STAGE}.scenes, or lower scenes_per_shard."
        )
    end_s = ended_ms / 1000 - times_s[-1]
    painting_s = len(times_s) * sum(shards_s) / len(shards_s) / workers
    pairs, size = _kept(folder / "data/copaintings" / setting, int(metrics["pairs"]), timing.run)
    return Rates(
        timing=timing,
        workers=workers,
        paintings=int(metrics["scenes"]),
        shards=int(metrics["shards"]),
        shards_s=shards_s,
        begin_s=max(timing.seconds - painting_s - end_s, 0.0),
        end_s=end_s,
        sizes=sizes_of({key.removeprefix("setting."): _value(text) for key, text in params.items()}),
        pairs=pairs,
        bytes=size,
        serial=tuple(timings[each] for each in needed_for(locked_stages(folder), setting) if each in timings),
        overhead=overhead,
    )


def shard_seconds(times_s: list[float], workers: int) -> tuple[float, ...]:
    """Return the duration of shards from their ascending end times, for workers that never waited.

    A worker that ends a shard begins the next one: shard k + W begins when shard k ends, if shards end in the order in
    which they began. The mean does not depend on that order; the spread does a little.
    """
    return tuple(times_s[k + workers] - times_s[k] for k in range(len(times_s) - workers))


def sizes_of(setting: Mapping[str, Any]) -> Sizes:
    """Return the sizes of a setting from its parameters, flattened, as in params.yaml or as a run recorded them."""
    sides_m = [parse_quantity(side, "m") if isinstance(side, str) else side for side in setting["canvas_m"]]
    width, height = (round(side * setting["planner.pixels_per_m"]) for side in sides_m)
    iterations = setting["planner.iterations_free"] + setting["planner.iterations_palette"]
    iterations += setting["planner.rounds"] * setting["planner.iterations_per_round"] / 4
    return Sizes(
        strokes=setting["strokes"],
        pixels=width * height,
        iterations=iterations + setting.get("guidance.iterations", 0),
        picture_pixels=setting["picture_px"] * round(setting["picture_px"] * sides_m[1] / sides_m[0]),
    )


def read_timings(folder: Path) -> dict[str, Timing]:
    """Return the timings in data/timings/ by stage item."""
    read = (json.loads(file.read_text(encoding="utf-8")) for file in sorted((folder / TIMINGS).glob("*.json")))
    return {each["stage"]: Timing(each["stage"], each["seconds"], each["finished"], each["run_id"]) for each in read}


def read_overhead(file: Path) -> Overhead:
    """Return the largest overhead that `python -m studies.cluster` measured, at least 0.

    Raises:
        PentimentoError: the study has not run yet.
    """
    if not file.is_file():
        raise PentimentoError(
            f"What a cluster takes beyond plain processes was not measured yet: {file} does not exist; run "
            "`python -m studies.cluster`, some minutes."
        )
    study = json.loads(file.read_text(encoding="utf-8"))
    share, workers = max((each["cluster_s"] / each["plain_s"] - 1, each["workers"]) for each in study["measured"])
    return Overhead(max(share, 0.0), workers, study["finished"])


def needed_for(stages: Mapping[str, Any], setting: str) -> list[str]:
    """Return the stage items of dvc.lock that the evaluation of a setting needs, itself included, without synthesis.

    For a setting that is not evaluated, return what its synthesis needs.
    """
    makers = {out["path"]: name for name, stage in stages.items() for out in stage.get("outs", [])}
    evaluation, synthesis = f"evaluate_copainting@{setting}", f"{STAGE}@{setting}"
    found, new = set[str](), {evaluation if evaluation in stages else synthesis}
    while new:
        found |= new
        read = {dep["path"] for name in new for dep in stages.get(name, {}).get("deps", [])}
        new = {makers[path] for path in read if path in makers} - found
    return sorted(found - {synthesis})


def _kept(folder: Path, pairs: int, run: str) -> tuple[int, int]:
    """Return pairs and bytes of the co-paintings in `folder`, which must be those of the run."""
    file = folder / "metrics.json"
    kept = json.loads(file.read_text(encoding="utf-8"))["pairs"] if file.is_file() else 0
    if kept != pairs:
        raise PentimentoError(
            f"{folder} holds {kept} pairs, but run {run[:8]}, the last that was timed, kept {pairs}; run `make repro`."
        )
    return pairs, sum(shard.stat().st_size for shard in folder.glob("*.parquet"))


def _value(text: str) -> Any:
    """Parse what MLflow keeps as text: numbers and tuples; words stay text."""
    try:
        return literal_eval(text)
    except (ValueError, SyntaxError):
        return text


_QUANTILES = (0.05, 0.95)  # of the shards, the ends of an interval


class Interval(NamedTuple):
    """A mean, and its values if all shards were as fast or as slow as the extreme twentieths."""

    mean: float
    low: float
    high: float


class FineTuning(NamedTuple):
    """Time and memory of fine-tuning Instruct-Pix2Pix at its published size, from a measured step; at most."""

    device: str
    seconds: float
    memory_bytes: float
    source: str


def fine_tunings(folder: Path, training: Mapping[str, Any]) -> tuple[FineTuning, ...]:
    """Return the fine-tuning of a profile's section `training` on each device on which a checkout measured its step.

    A GPU's step was measured with a larger batch and with all activations in memory. It counts once for a step of any
    smaller batch, and a third more if activations are computed again. A CPU's step is that of one pair on one core.
    """
    found = []
    steps, batch, kind = training["steps"], training["batch"], "whole" if training["lora"] is None else "lora"
    if (file := folder / ON_A_CPU / f"{kind}.json").is_file():
        one = json.loads(file.read_text(encoding="utf-8"))
        source = f"a step of one pair, {file.relative_to(folder)}"
        found.append(FineTuning("one CPU core", steps * batch * one["step_cpu_s"], one["peak_gb"] * 1e9, source))
    if (file := folder / ON_A_GPU).is_file():
        study = json.loads(file.read_text(encoding="utf-8"))
        for row in study["trainings"]:
            if (row["side_px"], row["precision"]) != (PUBLISHED_PX, training["precision"]) or row["batch"] < batch:
                continue
            if (row["lora"] is None) == (training["lora"] is None):
                seconds = steps * row["step_s"] * (_RECOMPUTED if training["gradient_checkpointing"] else 1.0)
                source = f"a step of {row['batch']} pairs, {file.relative_to(folder)}"
                found.append(FineTuning("one GPU", seconds, row["peak_gb"] * 1e9, source))
    return tuple(found)


class Factors(NamedTuple):
    """Ratios of planned to measured sizes. Time scales with their product, bytes with picture pixels alone."""

    strokes: float
    pixels: float
    iterations: float
    picture_pixels: float

    @property
    def time(self) -> float:
        return self.strokes * self.pixels * self.iterations


def factors(wanted: Sizes, measured: Sizes) -> Factors:
    """Return the ratios of wanted to measured sizes."""
    return Factors(
        wanted.strokes / measured.strokes,
        wanted.pixels / measured.pixels,
        wanted.iterations / measured.iterations,
        wanted.picture_pixels / measured.picture_pixels,
    )


@dataclass(frozen=True)
class Plan:
    """Paintings of one setting on machines with `cores` cores each."""

    rates: Rates
    paintings: int
    machines: int
    cores: int
    price: float | None
    """Of a machine for an hour, in any currency."""
    sizes: Sizes
    """Sizes of the planned paintings."""
    profile: str | None
    """The profile with these sizes; None for the measured sizes."""
    fine_tunings: tuple[FineTuning, ...] | None = None
    """Of the profile, on the devices where its step was measured; None where it does not train the published size."""

    @property
    def factors(self) -> Factors:
        return factors(self.sizes, self.rates.sizes)

    def painting_s(self) -> Interval:
        """Return the core-seconds of a painting at the measured sizes."""
        shards = np.array(self.rates.shards_s)
        return Interval(*(self.rates.painting_s(float(s)) for s in (shards.mean(), *np.quantile(shards, _QUANTILES))))

    def core_s(self) -> Interval:
        """Return the core-seconds of all paintings, shared by any number of workers."""
        return Interval(*(seconds * self.factors.time * self.paintings for seconds in self.painting_s()))

    def sharded_s(self, machines: int) -> Interval:
        """Return the wall time of painting. Several machines are a cluster, with its overhead."""
        factor = 1 + self.rates.overhead.share if machines > 1 else 1.0
        return Interval(*(seconds * factor / (machines * self.cores) for seconds in self.core_s()))

    def keeping_s(self) -> float:
        """Return the wall time after the last shard, which is proportional to the pixels of all pairs."""
        return self.rates.end_s * self.paintings / self.rates.paintings * self.factors.picture_pixels

    def serial_s(self) -> float:
        """Return the wall time of everything that one machine does alone."""
        return self.rates.begin_s + self.keeping_s() + sum(timing.seconds for timing in self.rates.serial)

    def wall_s(self, machines: int) -> Interval:
        """Return the total wall time."""
        return Interval(*(seconds + self.serial_s() for seconds in self.sharded_s(machines)))

    def speed_up(self, machines: int) -> float:
        """Return the speed-up over one machine."""
        return self.wall_s(1).mean / self.wall_s(machines).mean

    def cost(self, machines: int) -> Interval:
        """Return the price of all machines while they paint, and of one for the rest; needs `price`."""
        assert self.price is not None
        hourly = self.price / 3600
        return Interval(*(hourly * (machines * s + self.serial_s()) for s in self.sharded_s(machines)))

    def pairs(self) -> float:
        """Return the expected number of pairs of a partial and a full painting."""
        return self.rates.pairs / self.rates.paintings * self.paintings

    def kept_bytes(self) -> float:
        """Return the bytes of the pairs' shards on disk."""
        return self.rates.bytes / self.rates.pairs * self.pairs() * self.factors.picture_pixels

    def memory_bytes(self) -> float:
        """Return the bytes of the pairs' pictures, decoded: three a pixel. Fine-tuning holds a part at a time."""
        return 2 * 3 * self.sizes.picture_pixels * self.pairs()
