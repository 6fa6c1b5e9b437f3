"""What making co-paintings took in this checkout, as MLflow, data/timings/, the outputs and studies.cluster tell it."""

import json
from ast import literal_eval
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.units import parse_quantity
from pipelines._tracking.dvc_files import locked_stages
from pipelines._tracking.store import open_store
from pipelines._tracking.timings import TIMINGS

CLUSTER = Path("data/studies/cluster.json")
STAGE = "synthesize_copaintings"
_MIN_SHARDS = 4  # after the first of each worker, for a spread


class Timing(NamedTuple):
    """How long a stage item took the last time."""

    name: str
    seconds: float
    finished: str
    run: str


class Overhead(NamedTuple):
    """What a cluster takes beyond plain processes, as a share of their time."""

    share: float
    workers: int
    """Of the measurement with the largest share."""
    finished: str


@dataclass(frozen=True)
class Sizes:
    """What the time for one painting, and the bytes of its pictures, depend on."""

    strokes: int
    pixels: int
    """At which it is planned."""
    iterations: float
    """At full resolution: a round's are at half of it, and count a quarter."""
    picture_pixels: int


@dataclass(frozen=True)
class Rates:
    """Of one run of synthesize_copaintings, and of what cannot be sharded."""

    timing: Timing
    workers: int
    paintings: int
    shards: int
    shards_s: tuple[float, ...]
    """Seconds of one worker for each shard, after the first of each worker, which loads and compiles."""
    begin_s: float
    """Of the stage, before its workers paint: once a run."""
    end_s: float
    """Of the stage, after the last shard: scoring and keeping of all pairs."""
    sizes: Sizes
    pairs: int
    bytes: int
    """Of the pairs' shards, as they are kept."""
    serial: tuple[Timing, ...]
    """Stages that do not shard: all others that the evaluation of these paintings needs, and that evaluation."""
    overhead: Overhead

    def painting_s(self, shard_s: float) -> float:
        """Seconds of one core for a painting, where a shard takes `shard_s`."""
        return shard_s * self.shards / self.paintings


def read_rates(folder: Path, setting: str) -> Rates:
    """Return the rates measured in a checkout; call inside `store_errors`.

    Raises:
        PentimentoError: something was not measured yet, or what lies there is of another run.
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
    began_ms = ended_ms - 1000 * timing.seconds  # what an interrupted attempt painted before does not tell a rate
    times_s = sorted(
        point.timestamp / 1000 for point in client.get_metric_history(timing.run, "shards")
        if point.timestamp >= began_ms
    )  # fmt: skip
    workers = min(int(params["workers"]), max(len(times_s), 1))
    shards_s = shard_seconds(times_s, workers)
    if len(shards_s) < _MIN_SHARDS:
        raise PentimentoError(
            f"Run {timing.run[:8]} painted {len(times_s)} shards with {workers} workers, too few to tell a rate; raise "
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
    """How long shards took, from the times at which they ended, rising, of so many workers that never waited.

    Whoever ends a shard begins the next: shard k + W begins when shard k ends, as far as shards end in the order in
    which they began. Their mean does not depend on that, their spread does a little.
    """
    return tuple(times_s[k + workers] - times_s[k] for k in range(len(times_s) - workers))


def sizes_of(setting: Mapping[str, Any]) -> Sizes:
    """Sizes of a setting's parameters, nested names joined by dots, as in params.yaml or as a run recorded them."""
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
    """All of data/timings/, by stage item."""
    read = (json.loads(file.read_text(encoding="utf-8")) for file in sorted((folder / TIMINGS).glob("*.json")))
    return {each["stage"]: Timing(each["stage"], each["seconds"], each["finished"], each["run_id"]) for each in read}


def read_overhead(file: Path) -> Overhead:
    """The largest that `python -m studies.cluster` measured for any number of workers; 0 where it measured none.

    Raises:
        PentimentoError: it did not measure yet.
    """
    if not file.is_file():
        raise PentimentoError(
            f"What a cluster takes beyond plain processes was not measured yet: {file} does not exist; run "
            "`python -m studies.cluster`, some minutes."
        )
    told = json.loads(file.read_text(encoding="utf-8"))
    share, workers = max((each["cluster_s"] / each["plain_s"] - 1, each["workers"]) for each in told["measured"])
    return Overhead(max(share, 0.0), workers, told["finished"])


def needed_for(stages: Mapping[str, Any], setting: str) -> list[str]:
    """Stage items of dvc.lock that the evaluation of a setting's co-paintings needs, and itself, without synthesis.

    Where the setting is not evaluated: what its synthesis needs.
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
    """Pairs and bytes of the co-paintings in `folder`, which must be those of the run."""
    file = folder / "metrics.json"
    kept = json.loads(file.read_text(encoding="utf-8"))["pairs"] if file.is_file() else 0
    if kept != pairs:
        raise PentimentoError(
            f"{folder} holds {kept} pairs, but run {run[:8]}, the last that was timed, kept {pairs}; run `make repro`."
        )
    return pairs, sum(shard.stat().st_size for shard in folder.glob("*.parquet"))


def _value(text: str) -> Any:
    """What MLflow keeps as text: numbers and tuples as such, words as they are."""
    try:
        return literal_eval(text)
    except (ValueError, SyntaxError):
        return text
