"""Collect pushes into one material: executed by the robot in the studio, or read from a measured table."""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pentimento.collection.places import collect_places
from pentimento.collection.pushes import PushCollectionConfig, collect_pushes, repeat_floor_mm2, volume_figures
from pentimento.contracts.errors import ContractError
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.ranges import at_least
from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.tables import read_table, write_shards
from pentimento.control.place_safety import place_envelope_for
from pentimento.control.push_safety import GuardedSculptingRobot, push_envelope_for
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.planning.pushes.place_fit import MIN_PLACES
from pentimento.robots.tools import load_end_effector, load_feeder
from pentimento.robots.virtual import virtual_sculpting_robot
from pipelines._config import entry_of, load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, tracked_run


@dataclass(frozen=True)
class Pellets:
    """Pellets to which the place model is fitted."""

    feeder: str
    """A name or a TOML file."""
    count: int

    def __post_init__(self) -> None:
        at_least(self, MIN_PLACES, "count")


@dataclass(frozen=True)
class CollectPushes:
    """Section `collect_pushes` of params.yaml."""

    source: dict[str, str]
    """By material, a measured table in the pushes contract (a file or a folder of shards); others: the studio."""
    world: dict[str, str]
    """By material, the studio's clay world: a name or a TOML file; others: the world of the material's name."""
    end_effector: dict[str, str]
    """For each material the end-effector that presses it: a name or a TOML file."""
    pellets: dict[str, Pellets]
    """By material, pellets that are placed in the studio after the pushes; others: none."""
    collection: PushCollectionConfig


def main(arguments: argparse.Namespace) -> None:
    """Write `--out` as shards of the pushes contract, with `metrics.json`."""
    config = load_section(Path("params.yaml"), "collect_pushes", CollectPushes)
    single_threaded()
    material = arguments.material
    source, world = config.source.get(material), config.world.get(material, material)
    end_effector = entry_of(config.end_effector, material, "collect_pushes.end_effector")
    inputs = {} if source is None else {"source": Path(source)}
    with (
        tracked_run("collect_pushes", material, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        quarantined = 0
        if source is None:
            pellets = config.pellets.get(material)
            table = _collect(material, world, end_effector, config.collection, pellets, run)
            origin = f"Made by the robot with the {end_effector} in the studio, clay world `{world}`."
        else:
            checked = read_table(Path(source), CONTRACT)
            table, quarantined = checked.table, len(checked.quarantined)
            if table.num_rows == 0:
                raise ContractError(f"{source} holds no pushes; name another table in collect_pushes.source.")
            origin = f"Measured: `{Path(source).name}`, {quarantined} rows quarantined."
        metrics = {"rows": table.num_rows, "quarantined": quarantined, **_figures(table)}
        write_shards(out, table, CONTRACT)
        (out / "README.md").write_text(
            f"# Pushes into {material}\n\n{origin} {table.num_rows} rows.\n", encoding="utf-8"
        )
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)


def _collect(
    material: str,
    world: str,
    end_effector_name: str,
    config: PushCollectionConfig,
    pellets: Pellets | None,
    run: Run,
) -> pa.Table:
    robot = virtual_sculpting_robot(world, config.scan_pixels, config.seed)
    end_effector = load_end_effector(end_effector_name)
    feeder = None if pellets is None else load_feeder(pellets.feeder)
    places = None if feeder is None else place_envelope_for(feeder, robot.area_m)
    guarded = GuardedSculptingRobot(robot, push_envelope_for(end_effector, robot.area_m), places)
    rows = collect_pushes(guarded, end_effector, material, config, run.log)
    if feeder is not None and pellets is not None:
        rows += collect_places(
            guarded, feeder, material, count=pellets.count, edge_m=config.edge_m, seed=config.seed, first=len(rows)
        )
    names = {name for row in rows for name in row}
    schema = arrow_schema(CONTRACT, include_optional=names)
    for name in sorted(names - set(schema.names)):
        schema = schema.append(pa.field(name, pa.float32()))  # covariates of the room's sensors
    return pa.Table.from_pylist(rows, schema=schema)


def _figures(table: pa.Table) -> dict[str, Any]:
    """Return figures of the measured data, after the repairs that every reader of the table makes."""
    samples, repairs = load_pushes(table)
    resets = samples.covariates.get("reset_id", np.full(len(samples.action), np.nan))
    figures = volume_figures(samples.before, samples.after, samples.known, resets)
    floor = repeat_floor_mm2(samples.before, samples.after, samples.known, samples.action_id)
    return {
        "hole_share": repairs.holes,
        "left_out": len(repairs.bad) + len(repairs.copies),
        **figures,
        **({} if floor is None else {"repeat_floor_mm2": floor}),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="collect_pushes", description=__doc__)
    parser.add_argument("--material", required=True)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
