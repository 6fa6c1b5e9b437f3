"""`pentimento import`, `export`, `card` and `enough`; see docs/importing.md."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from pentimento.cli import Command, given, option, seed, workshop
from pentimento.contracts.errors import ConfigError, UnitError
from pentimento.contracts.units import parse_quantity

if TYPE_CHECKING:
    from pentimento.io.lerobot_in import Description
    from pentimento.io.stroke_rows import Imported, Placement


def _import(arguments: argparse.Namespace) -> None:
    from pentimento.io.lerobot_in import import_lerobot
    from pentimento.io.photo_pairs import import_photo_pairs
    from pentimento.io.scanned_page import import_page

    if arguments.paths.is_dir():
        imported = import_lerobot(arguments.paths, _description_of_dataset(arguments), arguments.out)
    elif arguments.page is not None:
        _needs(arguments, ("tool",), unwanted=("action", "camera", "units"), of="A CSV of paths with --page")
        imported = import_page(
            arguments.paths, arguments.page, arguments.blank, _placement(arguments), arguments.tool, arguments.out
        )
    else:
        unwanted = ("action", "camera", "units", "blank")
        _needs(arguments, ("photos", "tool"), unwanted=unwanted, of="A CSV of paths without --page")
        imported = import_photo_pairs(
            arguments.paths, arguments.photos, _placement(arguments), arguments.tool, arguments.out
        )
    print_imported(imported, arguments.out)


def print_imported(imported: Imported, out: Path) -> None:
    """Print how many strokes are in the table `out`, and which were refused and why."""
    print(f"{imported.rows} strokes are in {out}.")
    for reason, strokes in imported.refused.items():
        print(f"Refused: {len(strokes)} × {reason} ({', '.join(strokes[:8])}{', …' if len(strokes) > 8 else ''}).")
    print(f"What they hold: pentimento card {out}")


def _description_of_dataset(arguments: argparse.Namespace) -> Description | None:
    """Return the description of a dataset given by the options; None where none is given."""
    from pentimento.io.lerobot_in import Description

    options = ("tool", "window", "scale", "y_down", "action", "camera", "units", "page", "blank")
    if arguments.photos is None and not any(getattr(arguments, name) for name in options):
        return None
    _needs(
        arguments,
        ("tool",),
        unwanted=("photos", "page", "blank"),
        of="A LeRobot dataset that was not exported from strokes",
    )
    try:
        unit_m = parse_quantity(f"1 {arguments.units or 'm'}", "m")
    except UnitError as error:
        raise ConfigError(f"--units {arguments.units} is no unit of length: {error}") from error
    return Description(_placement(arguments), arguments.tool, unit_m, arguments.action, arguments.camera)


def _needs(arguments: argparse.Namespace, needed: tuple[str, ...], unwanted: tuple[str, ...], of: str) -> None:
    missing = [f"--{name}" for name in needed if getattr(arguments, name) is None]
    if arguments.window is None and arguments.scale is None:
        missing.append("--window or --scale")
    if missing:
        raise ConfigError(f"{of} needs {', '.join(missing)}; see docs/importing.md.")
    if unused := given(arguments, unwanted):
        raise ConfigError(f"{of} has no use for {', '.join(unused)}; leave it out.")


def _placement(arguments: argparse.Namespace) -> Placement:
    from pentimento.io.stroke_rows import Placement

    return Placement.parsed(arguments.window, arguments.scale, arguments.y_down)


def _export(arguments: argparse.Namespace) -> None:
    from pentimento.io.lerobot_out import export_lerobot

    exported = export_lerobot(arguments.rows, arguments.lerobot, arguments.fps)
    for bad in exported.quarantined:
        print(f"Row {bad.row} breaks the contract and is left out: {bad.reason}.")
    print(
        f"{exported.episodes} strokes are in {arguments.lerobot}: {exported.frames} frames, {arguments.fps} a second."
    )


def _card(arguments: argparse.Namespace) -> None:
    with workshop("write a card"):
        from pentimento.io.card import write_card
    place, warnings = write_card(arguments.rows, arguments.out)
    for warning in warnings:
        print(warning)
    print(f"The card is {place}.")


def _enough(arguments: argparse.Namespace) -> None:
    with workshop("fit models"):
        from pentimento.dynamics.strokes.learning_curve import learning_curve_of
    curve, sampling = learning_curve_of(arguments.rows, arguments.seed)
    print(sampling.sentence)
    for line in curve.lines():
        print(line)
    print(curve.sentence)


_ROWS = option("rows", type=Path, metavar="ROWS", help="strokes: a Parquet file, or a folder of shards")

COMMANDS = (
    Command(
        "import",
        "recorded strokes: a CSV of paths with photographs or one page, or a LeRobot dataset",
        (
            option(
                "paths",
                type=Path,
                metavar="PATHS",
                help="CSV: stroke, t_s, x_mm, y_mm, z_mm (or press_mm), …; or the folder of a LeRobot v3.0 dataset",
            ),
            option(
                "--photos",
                type=Path,
                metavar="FOLDER",
                exclusive="pictures",
                help="for a CSV: with <stroke>_before.png and <stroke>_after.png",
            ),
            option(
                "--page",
                type=Path,
                metavar="FILE",
                exclusive="pictures",
                help="for a CSV: one picture of the page after all its strokes, in place of --photos",
            ),
            option("--blank", type=Path, metavar="FILE", help="with --page: the page before the first stroke"),
            option(
                "--action",
                metavar="NAMES",
                help='of a dataset: which values of its actions are x, y, z and yaw; "x,y,z,yaw"',
            ),
            option("--camera", metavar="FEATURE", help="of a dataset: which feature shows the canvas"),
            option("--units", metavar="UNIT", help="of a dataset: its unit of length, metres by default"),
            option(
                "--window",
                metavar="EDGES",
                exclusive="place",
                help='what every photograph shows, such as "0 mm, 0 mm, 300 mm, 200 mm": left, lower, right and upper '
                "edge in the paths' frame",
            ),
            option(
                "--scale",
                metavar="SCALE",
                exclusive="place",
                help='pixels over length, such as "5 px/mm": the lower left corner is 0, 0',
            ),
            option("--y-down", action="store_true", help="y grows downwards in PATHS, from the photograph's top"),
            option("--tool", metavar="NAME", help="that made the strokes"),
            option("--out", required=True, type=Path, metavar="FOLDER", help="for the table and its data card"),
        ),
        _import,
    ),
    Command(
        "export",
        "strokes as a LeRobot v3.0 dataset",
        (
            _ROWS,
            option("--lerobot", required=True, type=Path, metavar="FOLDER", help="for the dataset"),
            option("--fps", type=int, default=30, metavar="N", help="frames a second"),
        ),
        _export,
    ),
    Command(
        "card",
        "the data card of a table of strokes or pushes: what it holds, and which causes it cannot show",
        (
            option("rows", type=Path, metavar="ROWS", help="a Parquet file, or a folder of shards"),
            option("--out", type=Path, metavar="FILE", help="Markdown; by default next to the rows"),
        ),
        _card,
    ),
    Command(
        "enough",
        "whether more strokes would make a better model: a learning curve",
        (_ROWS, option("--seed", type=seed, default=0, help="of the shares and the bootstrap")),
        _enough,
    ),
)
