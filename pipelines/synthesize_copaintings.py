"""Paint captioned scenes in one setting and keep pairs of a partial and a full painting (thesis 6.4.1)."""

import argparse
import shutil
import signal
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import pyarrow as pa
import pyarrow.compute as pc

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.scenes import CONTRACT, SPLITS
from pentimento.contracts.tables import read_table
from pentimento.copainting.scratch import scratch_folder
from pentimento.copainting.synthesis.dataset_card import dataset_card
from pentimento.copainting.synthesis.kept_pairs import keep_pairs, threshold_of
from pentimento.copainting.synthesis.pairs import Setting, load_painter
from pentimento.copainting.synthesis.partials import PartialsConfig
from pentimento.copainting.synthesis.preview import preview
from pentimento.copainting.synthesis.score_filter import Threshold
from pentimento.copainting.synthesis.shards import Job, paint_shards
from pentimento.semantics.encoder import Encoder
from pipelines._config import entry_of, load_section
from pipelines._io import end_with_parent, output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import input_digest, tracked_run

SCRATCH = Path(".pentimento/synthesis")
_SHOWN = 12


@dataclass(frozen=True)
class SceneCounts:
    """How many scenes of each split are painted, the table's first, as far as there are so many."""

    train: int
    val: int
    test: int

    def __post_init__(self) -> None:
        at_least(self, 0, *SPLITS)


@dataclass(frozen=True)
class SynthesizeCopaintings:
    """Section `synthesize_copaintings` of params.yaml."""

    scenes: SceneCounts
    scenes_per_shard: int
    """What one worker paints at a time, and what is lost of its work when it is killed."""
    workers: int
    """Processes; any number makes the same bytes."""
    scheduler: str | None
    """Address of a dask scheduler whose workers paint instead, or null."""
    threshold: Threshold
    partials: PartialsConfig
    settings: dict[str, Setting]

    def __post_init__(self) -> None:
        at_least(self, 1, "scenes_per_shard", "workers")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: shards of the copaintings contract with a card, preview.png and metrics.json."""
    config = load_section(Path("params.yaml"), "synthesize_copaintings", SynthesizeCopaintings)
    setting = entry_of(config.settings, arguments.setting, "synthesize_copaintings.settings")
    if setting.tool not in arguments.tools:
        raise ConfigError(
            f"params.yaml: synthesize_copaintings.settings.{arguments.setting}.tool is {setting.tool!r}, but dvc.yaml "
            f"hands the stage models of {', '.join(arguments.tools)} only: hand it that model, too."
        )
    single_threaded()
    stroke_model = arguments.models / f"stroke_{setting.tool}" / "weights"
    inputs = {"scenes": arguments.scenes, "stroke_model": stroke_model, "semantics": arguments.semantics}
    what = {"scenes": asdict(config.scenes), "scenes_per_shard": config.scenes_per_shard}
    what |= {"partials": asdict(config.partials), "setting": asdict(setting)}
    digests = {name: input_digest(path) for name, path in inputs.items()}
    scratch = scratch_folder(SCRATCH, f"synthesize_copaintings@{arguments.setting}", what, digests)
    params = what | {"workers": config.workers, "scheduler": config.scheduler, "threshold": asdict(config.threshold)}
    with (
        tracked_run("synthesize_copaintings", arguments.setting, params, inputs) as run,
        output_folder(arguments.out) as out,
    ):
        load_painter(arguments.setting, setting, stroke_model, arguments.semantics)  # its errors before any work
        scenes = chosen(arguments.scenes, config.scenes)
        rows, step = scenes.to_pylist(), config.scenes_per_shard
        jobs = [
            Job(arguments.setting, setting, config.partials, stroke_model, arguments.semantics, rows[i : i + step])
            for i in range(0, len(rows), step)
        ]
        files = paint_shards(jobs, scratch, config.workers, config.scheduler, _begin_work, run.log)
        encoder = Encoder.load(arguments.semantics)
        least = threshold_of(config.threshold, encoder, files)
        metrics = keep_pairs(files, least, out) | {"scenes": len(rows)}
        card = dataset_card(arguments.setting, setting, config.threshold, metrics, scenes, encoder.digest)
        (out / "README.md").write_text(card)
        write_png(out / "preview.png", preview(rows[:_SHOWN], files))
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "preview.png")
    shutil.rmtree(scratch, ignore_errors=True)


def chosen(folder: Path, counts: SceneCounts) -> pa.Table:
    """The scenes to paint, split by split.

    Raises:
        ContractError: they lack ids or splits, or there is none of a split that is asked for.
    """
    table = read_table(folder, CONTRACT).table
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


def _begin_work() -> None:
    """A worker ends with the stage, leaves Ctrl-C to it, and keeps to one core."""
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
