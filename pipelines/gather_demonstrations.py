"""Gather demonstrations: recordings of people's strokes, or strokes of synthetic writers, in one table."""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pentimento.contracts.demonstrations import CONTRACT
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import write_shards
from pentimento.handwriting.figures import sheet, sheet_of_repaired
from pentimento.handwriting.gather import Source, gather, read_source
from pentimento.handwriting.repair import Limits
from pentimento.handwriting.synthetic_writers import SyntheticConfig, synthetic_sessions
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run


@dataclass(frozen=True)
class GatherDemonstrations:
    """Section `gather_demonstrations` of params.yaml."""

    points: int
    """Of each stroke in the table, at equal steps of arc length (thesis 5.3.2: 32)."""
    sources: list[Source]
    """Recordings; without any, synthetic writers draw."""
    synthetic: SyntheticConfig
    limits: Limits

    def __post_init__(self) -> None:
        at_least(self, 2, "points")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: shards of the demonstrations contract, pictures of kept and dropped strokes, and metrics.json."""
    config = load_section(Path("params.yaml"), "gather_demonstrations", GatherDemonstrations)
    single_threaded()
    inputs = {f"source.{number}": Path(source.path) for number, source in enumerate(config.sources)}
    with (
        tracked_run("gather_demonstrations", None, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        recordings = [stroke for source in config.sources for stroke in read_source(source)]
        if not config.sources:
            recordings = synthetic_sessions(config.synthetic)
        found = gather(recordings, config.limits, config.points)
        write_shards(out, found.table, CONTRACT)
        points = np.array(found.table.column("points").to_pylist())
        hands = found.table.column("hand").to_pylist()
        shown = [n for hand in dict.fromkeys(hands) for n in [k for k, name in enumerate(hands) if name == hand][:24]]
        write_png(out / "strokes.png", sheet([points[n, :, 1:3] for n in shown]))
        write_png(out / "dropped.png", sheet_of_repaired(found.repaired))
        origin = "Recorded by people." if config.sources else "Made up by sigma-lognormal movements; nobody drew them."
        (out / "README.md").write_text(
            f"# Demonstrations\n\n{origin} {found.table.num_rows} strokes.\n", encoding="utf-8"
        )
        write_json(out / "metrics.json", found.counts)
        run.log_metrics(found.counts)
        for name in ("strokes.png", "dropped.png"):
            run.log_picture(out / name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="gather_demonstrations", description=__doc__)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
