"""Draw scenes of things with names from the packages of drawings, for the encoders of the base."""

import argparse
from dataclasses import asdict
from pathlib import Path

from pentimento.contracts.images import write_png
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.tables import write_table
from pentimento.copainting.drawings.pairs import DrawnScenesConfig, drawn_scenes
from pentimento.copainting.drawings.sources import LICENCES
from pipelines._config import entry_of, load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run
from pipelines.build_scenes import preview, scene_metrics


def main(arguments: argparse.Namespace) -> None:
    """Write `--out` as a table of the scenes contract, with preview.png and metrics.json."""
    sections = load_section(arguments.params, "draw_scenes", dict[str, DrawnScenesConfig])
    config = entry_of(sections, arguments.reader, "draw_scenes")
    single_threaded()
    with (
        tracked_run("draw_scenes", arguments.reader, asdict(config), {"archives": arguments.archives}) as run,
        output_folder(arguments.out) as out,
    ):
        table = drawn_scenes(config, arguments.archives)
        licences = ", ".join(f"{source} ({LICENCES[source]})" for source in config.sources)
        write_table(out / "table", table, CONTRACT, f"# Scenes of named things\n\nDrawings by {licences}.")
        for file in sorted((out / "table").iterdir()):
            file.rename(out / file.name)
        (out / "table").rmdir()
        metrics = scene_metrics(table, {})
        write_png(out / "preview.png", preview(table))
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "preview.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="draw_scenes", description=__doc__)
    parser.add_argument("--params", required=True, type=Path)
    parser.add_argument("--reader", required=True, help="which encoder learns from the scenes: guide or judge")
    parser.add_argument("--archives", required=True, type=Path, help="folder of fetch_drawings")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
