"""Build captioned scenes for co-painting: drawn procedurally, or imported from a local data set."""

import argparse
from collections import Counter
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.images import decode_png, write_png
from pentimento.contracts.scenes import CONTRACT, SPLITS
from pentimento.contracts.tables import write_table
from pentimento.copainting.drawings.pairs import DrawnScenesConfig, drawn_scenes
from pentimento.copainting.drawings.sources import LICENCES
from pentimento.copainting.scenes.imported_scenes import ImportedConfig, import_scenes
from pentimento.copainting.scenes.procedural import ScenesConfig, build_scenes
from pentimento.semantics.segmentation import SegmentationConfig, segment
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, tracked_run

_GRID = (6, 12)


@dataclass(frozen=True)
class BuildScenes:
    """Section `build_scenes` of params.yaml."""

    named: DrawnScenesConfig | None
    """Scenes of named things from packages of drawings; null for `drawn` or `imported`."""
    drawn: ScenesConfig
    """Scenes of made-up things, which need no package."""
    imported: ImportedConfig | None
    """A local data set instead of the drawn scenes, or null."""
    segmentation: SegmentationConfig
    """Of imported pictures, which come without regions."""


def main(arguments: argparse.Namespace) -> None:
    """Write `--out` as a table of the scenes contract, with preview.png and metrics.json."""
    config = load_section(Path("params.yaml"), "build_scenes", BuildScenes)
    single_threaded()
    inputs = {} if config.imported is None else {"source": Path(config.imported.path)}
    with tracked_run("build_scenes", None, asdict(config), inputs) as run, output_folder(arguments.out) as out:
        table, quarantined, origin = _scenes(config, run)
        metrics = scene_metrics(table, quarantined)
        card = (
            f"# Scenes\n\n{origin} {table.num_rows} captioned pictures with regions; "
            f"{sum(quarantined.values())} left out."
        )
        write_table(out / "table", table, CONTRACT, card)
        for file in sorted((out / "table").iterdir()):
            file.rename(out / file.name)
        (out / "table").rmdir()
        write_png(out / "preview.png", preview(table))
        write_json(out / "metrics.json", metrics)
        run.log_metrics(metrics)
        run.log_picture(out / "preview.png")


def _scenes(config: BuildScenes, run: Run) -> tuple[pa.Table, dict[str, int], str]:
    if config.imported is None and config.named is not None:
        licences = ", ".join(f"{source} ({LICENCES[source]})" for source in config.named.sources)
        return drawn_scenes(config.named, None), {}, f"Drawings by {licences}."
    if config.imported is None:
        origin = (
            "Drawn by procedure; test and validation hold pairs of kinds, and kinds in colours, not seen in training."
        )
        return build_scenes(config.drawn, run.log), {}, origin
    imported = import_scenes(config.imported, partial(segment, config=config.segmentation))
    origin = f"Taken from {config.imported.source}, licence {config.imported.licence}."
    return imported.table, imported.quarantined, origin


def scene_metrics(table: pa.Table, quarantined: dict[str, int]) -> dict[str, Any]:
    """Return the counts of a scenes table, and of the rows that were left out, by reason."""
    splits = Counter(table.column("split").to_pylist())
    objects = [kinds or [] for kinds in table.column("objects").to_pylist()]
    return {
        "scenes": table.num_rows,
        "split": {split: splits[split] for split in SPLITS},
        "kinds": len({kind for kinds in objects for kind in kinds}),
        "objects": {str(number): count for number, count in sorted(Counter(map(len, objects)).items())},
        "distinct_captions": len({text for texts in table.column("captions").to_pylist() for text in texts}),
        "quarantined": {"all": sum(quarantined.values()), **quarantined},
    }


def preview(table: pa.Table) -> NDArray[np.uint8]:
    """Return the first scenes in a grid, each above its regions in grey."""
    rows, columns = _GRID
    cells = []
    for row in table.slice(0, rows * columns // 2).select(["image", "regions"]).to_pylist():
        image, regions = decode_png(row["image"]["bytes"]), decode_png(row["regions"]["bytes"])
        shades = np.rint(255 * regions.astype(float) / max(1, int(regions.max()))).astype(np.uint8)
        cells.append(np.concatenate([image, np.repeat(shades[..., None], 3, axis=2)]))
    blank = np.full_like(cells[0], 255)
    cells += [blank] * (-len(cells) % columns)
    lines = [np.concatenate(cells[start : start + columns], axis=1) for start in range(0, len(cells), columns)]
    return np.concatenate(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="build_scenes", description=__doc__)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
