"""Paint captioned scenes in one setting and keep pairs of a partial and a full painting (thesis 6.4.1)."""

import argparse
import shutil
import signal
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pentimento.contracts import copaintings
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.scenes import CONTRACT, SPLITS
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.tables import read_table
from pentimento.copainting.jobs import scratch_folder
from pentimento.copainting.scenes.collage import as_drawn, half_scenes, pairs_in_training, shows_named_things
from pentimento.copainting.synthesis.dataset import Threshold, dataset_card, keep_pairs, preview, threshold_of
from pentimento.copainting.synthesis.painter import Setting, load_painter
from pentimento.copainting.synthesis.pairs import beside_pairs, usable_captions, window_pairs
from pentimento.copainting.synthesis.partials import PartialsConfig
from pentimento.copainting.synthesis.shards import Job, paint_shards
from pentimento.robots.tools import load_tool
from pentimento.semantics.encoder import Encoder
from pipelines._config import entry_of, load_section, require_model
from pipelines._io import end_with_parent, output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import input_digests, tracked_run

SCRATCH = Path(".pentimento/synthesis")
_SHOWN = 12


@dataclass(frozen=True)
class SceneCounts:
    """Maximum number of scenes of each split that are painted, in the order of the table."""

    train: int
    val: int
    test: int

    def __post_init__(self) -> None:
        at_least(self, 0, *SPLITS)


@dataclass(frozen=True)
class SynthesizeCopaintings:
    """Section `synthesize_copaintings` of params.yaml."""

    scenes: SceneCounts
    half_scenes: SceneCounts
    """Scenes with one object in one half of the sheet, from the table's first scenes with one object."""
    pairs_per_half_scene: int
    """Maximum number of pairs of each half scene: its object is to be added to the other half's."""
    pairs_per_named_thing: int
    """Maximum number of pairs of each painting of one named thing: it is to be added where another one is in view."""
    scenes_per_shard: int
    """Scenes that one worker paints at a time; a killed worker loses as many."""
    workers: int
    """Processes; the output does not depend on the number."""
    scheduler: str | None
    """Address of a dask scheduler whose workers paint instead, or null."""
    threshold: Threshold
    partials: PartialsConfig
    settings: dict[str, Setting]

    def __post_init__(self) -> None:
        at_least(self, 1, "scenes_per_shard", "workers")
        at_least(self, 0, "pairs_per_half_scene", "pairs_per_named_thing")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: shards of the copaintings contract with a card, preview.png and metrics.json."""
    config = load_section(Path("params.yaml"), "synthesize_copaintings", SynthesizeCopaintings)
    setting = entry_of(config.settings, arguments.setting, "synthesize_copaintings.settings")
    require_model(f"synthesize_copaintings.settings.{arguments.setting}.tool", setting.tool, arguments.tools)
    single_threaded()
    stroke_model = arguments.models / f"stroke_{setting.tool}" / "weights"
    inputs = {"scenes": arguments.scenes, "stroke_model": stroke_model, "semantics": arguments.semantics}
    what = {
        "scenes": asdict(config.scenes), "half_scenes": asdict(config.half_scenes),
        "pairs_per_half_scene": config.pairs_per_half_scene, "pairs_per_named_thing": config.pairs_per_named_thing,
        "scenes_per_shard": config.scenes_per_shard,
        "partials": asdict(config.partials), "setting": asdict(setting),
    }  # fmt: skip
    digests = input_digests(inputs)
    scratch = scratch_folder(SCRATCH, f"synthesize_copaintings@{arguments.setting}", what, digests)
    params = what | {"workers": config.workers, "scheduler": config.scheduler, "threshold": asdict(config.threshold)}
    with (
        tracked_run("synthesize_copaintings", arguments.setting, params, inputs) as run,
        output_folder(arguments.out) as out,
    ):
        load_painter(arguments.setting, setting, stroke_model, arguments.semantics)  # so that its errors come first
        has_ink = load_tool(setting.tool).color_srgb is not None
        table = as_drawn(read_table(arguments.scenes, CONTRACT).table, with_pen=has_ink and setting.ink is None)
        scenes = chosen(table, config.scenes, arguments.scenes)
        halves = halves_of(table, config.half_scenes, setting.planner.seed)
        rows, half_rows, step = scenes.to_pylist(), halves.to_pylist(), config.scenes_per_shard
        from_blank = replace(config.partials, random=0, salient_shares=(), semantic=0)
        jobs = [
            Job(arguments.setting, setting, partials, stroke_model, arguments.semantics, of[i : i + step])
            for of, partials in ((rows, config.partials), (half_rows, from_blank))
            for i in range(0, len(of), step)
        ]
        files = paint_shards(
            jobs, scratch, workers=config.workers, scheduler=config.scheduler, in_each_worker=_begin_work, log=run.log
        )
        encoder = Encoder.load(arguments.semantics)
        minimum = threshold_of(config.threshold, encoder, files)
        of_halves = files[len(files) - -(-len(half_rows) // step) :]
        files += write_beside(of_halves, half_rows, table, setting, minimum, config.pairs_per_half_scene, scratch)
        if shows_named_things(table):
            files += write_windows(files, rows, table, setting, minimum, config.pairs_per_named_thing, scratch)
        metrics = keep_pairs(files, minimum, out) | {"scenes": len(rows) + len(half_rows)}
        card = dataset_card(
            arguments.setting, setting, config.threshold, metrics=metrics, scenes=scenes, scorer=encoder.digest
        )
        (out / "README.md").write_text(card, encoding="utf-8")
        write_png(out / "preview.png", preview(rows[:_SHOWN], files))
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "preview.png")
    shutil.rmtree(scratch, ignore_errors=True)


def chosen(table: pa.Table, counts: SceneCounts, folder: Path) -> pa.Table:
    """Return the scenes of `folder` to paint, split by split.

    Raises:
        ContractError: they lack ids or splits, or there is none of a split that is asked for.
    """
    for name in ("scene_id", "split"):
        if name not in table.column_names or table[name].null_count:
            raise ContractError(f"The scenes in {folder} lack {name}, which co-paintings carry on; use build_scenes.")
    parts = []
    for split, count in asdict(counts).items():
        part = table.filter(pc.equal(table["split"], split)).slice(0, count)
        if count and not part.num_rows:
            raise ContractError(f"The scenes in {folder} hold none of split {split}; {count} are asked for.")
        parts.append(part)
    together = pa.concat_tables(parts)
    if not together.num_rows:
        raise ContractError("synthesize_copaintings.scenes asks for no scene at all; raise a count.")
    return together


def halves_of(table: pa.Table, counts: SceneCounts, seed: int) -> pa.Table:
    """Return the half scenes to paint, split by split."""
    parts = [
        half_scenes(table.filter(pc.equal(table["split"], split)), count, seed)
        for split, count in asdict(counts).items()
    ]
    return pa.concat_tables(parts)


def write_beside(
    files: Sequence[Path],
    halves: Sequence[Mapping[str, Any]],
    table: pa.Table,
    setting: Setting,
    minimum: float,
    number: int,
    scratch: Path,
) -> list[Path]:
    """Write a shard of pairs that ask for one object beside another, from halves with a sufficient score."""
    good = _good(files, minimum)
    together = pairs_in_training(table.filter(pc.equal(table["split"], "train")))
    captions_of = partial(usable_captions, tool=load_tool(setting.tool))
    by_id = {row["scene_id"]: row for row in halves}
    rows = beside_pairs(good, by_id, captions_of, together=together, number=number, seed=setting.planner.seed)
    return _written(rows, scratch / "part-beside.parquet")


def write_windows(
    files: Sequence[Path],
    scenes: Sequence[Mapping[str, Any]],
    table: pa.Table,
    setting: Setting,
    minimum: float,
    number: int,
    scratch: Path,
) -> list[Path]:
    """Write a shard of pairs that ask for one named thing where another is in view, with a sufficient score."""
    by_id = {row["scene_id"]: row for row in scenes if len(row["objects"]) == 1}
    whole = [row for row in _good(files, minimum) if row["strategy"] == "all" and row["scene_id"] in by_id]
    rows = window_pairs(whole, by_id, together=pairs_in_training(table), number=number, seed=setting.planner.seed)
    return _written(rows, scratch / "part-windows.parquet")


def _good(files: Sequence[Path], minimum: float) -> list[dict[str, Any]]:
    painted = [row for file in files for row in read_table(file, copaintings.CONTRACT).table.to_pylist()]
    return [row for row in painted if row["clip_score"] >= minimum]


def _written(rows: Sequence[dict[str, Any]], file: Path) -> list[Path]:
    """A shard of rows; no file without rows."""
    if not rows:
        return []
    pq.write_table(pa.Table.from_pylist(rows, schema=arrow_schema(copaintings.CONTRACT)), file, compression="zstd")
    return [file]


def _begin_work() -> None:
    """Let a worker end with the stage, ignore Ctrl-C, and use one core."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="synthesize_copaintings", description=__doc__)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--scenes", required=True, type=Path)
    parser.add_argument("--models", required=True, type=Path, help="folder of stroke_<tool>")
    parser.add_argument("--tools", required=True, nargs="+", help="whose models are there")
    parser.add_argument("--semantics", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
