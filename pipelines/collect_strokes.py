"""Collect strokes of one tool: executed by the robot in the studio, or read from a measured table."""

import argparse
import shutil
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pentimento.collection.collect import collect_strokes
from pentimento.collection.design import CollectionConfig, design_collection
from pentimento.collection.rehearse import rehearse
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import CheckedTable, read_table, write_shards
from pentimento.control.guard import GuardedRobot
from pentimento.control.safety import envelope_for
from pentimento.diagnosis.experiment_design import Aliasing, aliasing_in_short
from pentimento.diagnosis.strokes.aliasing import aliasing_of
from pentimento.diagnosis.strokes.fit import first_model
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.registration import register
from pentimento.io.contact_sheet import SHEET
from pentimento.io.pair_arrays import SUFFIX, import_pair_arrays, read_pairs
from pentimento.io.stroke_rows import Placement
from pentimento.planning.strokes.latent import read_decoder
from pentimento.planning.strokes.shapes import Shapes
from pentimento.robots.tools import Tool, load_tool
from pentimento.robots.virtual import VirtualRobot
from pentimento.studio.strokes.studio import Studio
from pentimento.studio.strokes.world import load_world
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, tracked_run


@dataclass(frozen=True)
class PairsConfig:
    """What an .npz of paths and pictures does not say; as the options of `pentimento import`."""

    unit_m: float
    """Length of the unit of its paths."""
    press_m: float | None
    """Depth of the tip where z is 1; null: z is a height."""
    window_m: tuple[float, float, float, float]
    """Left, lower, right and upper edge of the pictures in the frame of the paths, y up."""


@dataclass(frozen=True)
class CollectStrokes:
    """Section `collect_strokes` of params.yaml."""

    source: dict[str, str]
    """By tool, a measured table in the strokes contract (a file or a folder of shards), or an .npz of paths and
    pictures; other tools: the studio."""
    pairs: dict[str, PairsConfig]
    """By tool whose source is an .npz: its units and window."""
    world: dict[str, str]
    """By tool, the studio's world: a name or a TOML file; other tools: the world of the tool's name."""
    hand: dict[str, str]
    """By tool, the file of a handwriting style whose strokes are collected; other tools: Bézier strokes."""
    registered: list[str]
    """Tools whose measured strokes a person made: each path is moved onto its ink."""
    collection: CollectionConfig

    def __post_init__(self) -> None:
        if unknown := sorted(set(self.registered) - self.source.keys()):
            raise ValueError(f"registered names {', '.join(unknown)}, for which source names no measured table.")
        if both := sorted(self.source.keys() & self.hand.keys()):
            raise ValueError(f"source and hand both name {', '.join(both)}; a measured table needs no hand.")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out` as shards of the strokes contract, with `metrics.json`."""
    config = load_section(Path("params.yaml"), "collect_strokes", CollectStrokes)
    single_threaded()
    source, world = config.source.get(arguments.tool), config.world.get(arguments.tool, arguments.tool)
    hand = config.hand.get(arguments.tool)
    inputs = {name: Path(path) for name, path in (("source", source), ("hand", hand)) if path is not None}
    with (
        tracked_run("collect_strokes", arguments.tool, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        metrics: dict[str, Any] = {"quarantined": 0, "recorded": source is not None}
        if source is None:
            writer = None if hand is None else read_decoder(Path(hand))
            table, metrics["largest_aliasing"] = _collect(arguments.tool, world, config.collection, writer, run)
            drawn = "Bézier strokes" if writer is None else f"Strokes in the handwriting style “{writer.hand}”"
            origin = f"{drawn}, made by the robot in the studio, world `{world}`."
        else:
            pairs = config.pairs.get(arguments.tool)
            if (pairs is None) == (Path(source).suffix == SUFFIX):
                raise ConfigError(
                    f"collect_strokes.source.{arguments.tool} is {source}, and collect_strokes.pairs has "
                    f"{'no entry' if pairs is None else 'an entry'} for it: an {SUFFIX} needs one, a table none."
                )
            checked = (
                read_table(Path(source), CONTRACT)
                if pairs is None
                else _paired(Path(source), pairs, arguments.tool, out)
            )
            table, metrics["quarantined"] = checked.table, len(checked.quarantined)
            if table.num_rows == 0:
                raise ContractError(f"{source} holds no strokes; name another table in collect_strokes.source.")
            origin = f"Measured: `{Path(source).name}`, {metrics['quarantined']} rows quarantined."
            if arguments.tool in config.registered:
                registered = register(table)
                table, origin = registered.table, f"{origin} {registered.sentence}"
        metrics["rows"] = table.num_rows
        write_shards(out, table, CONTRACT)
        (out / "README.md").write_text(
            f"# Strokes of the {arguments.tool}\n\n{origin} {table.num_rows} rows.\n", encoding="utf-8"
        )
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)


def _paired(source: Path, config: PairsConfig, tool: str, out: Path) -> CheckedTable:
    """The rows of an .npz; ``out`` gets its contact sheet."""
    pairs = read_pairs(source, config.unit_m, config.press_m)
    for sentence in pairs.assumed:
        print(sentence, file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        imported = Path(folder, "strokes")
        import_pair_arrays(source, pairs, Placement(config.window_m, None, False), tool, imported)
        checked = read_table(imported, CONTRACT)
        shutil.copyfile(imported / SHEET, out / SHEET)
    return checked


def _collect(
    tool_name: str, world: str, config: CollectionConfig, shapes: Shapes | None, run: Run
) -> tuple[pa.Table, float]:
    """Return the strokes, and the largest aliasing between causes under their design (docs/diagnosis.md §11)."""
    tool = load_tool(tool_name)
    robot = VirtualRobot(Studio(load_world(world), config.seed))
    found = _aliasing(tool, robot.canvas_size_m, config, shapes)
    print(f"Causes that this design cannot distinguish: {aliasing_in_short(found)}.", file=sys.stderr)
    guarded = GuardedRobot(robot, envelope_for(tool, robot.canvas_size_m))
    rows = collect_strokes(guarded, tool, config, run.log, shapes)
    return pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0]))), found.largest


def _aliasing(
    tool: Tool, canvas_size_m: tuple[float, float], config: CollectionConfig, shapes: Shapes | None
) -> Aliasing:
    """Compute aliasing from the commands alone, before anything is drawn."""
    palette = np.array(config.palette_srgb if tool.color_srgb is None else [tool.color_srgb])
    commands = design_collection(tool, canvas_size_m, palette, config, shapes)
    strokes = load_measured(rehearse(commands, tool, canvas_size_m, config))
    return aliasing_of(first_model(strokes), strokes, VOCABULARY)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="collect_strokes", description=__doc__)
    parser.add_argument("--tool", required=True)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
