"""`pentimento import`, `card` and `enough`; see docs/importing.md."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pentimento.commands.workshop import workshop


def add(commands: Any, seed: Callable[[str], int]) -> None:
    """The subcommands about recordings; ``seed`` parses its option."""
    imports = commands.add_parser("import", help="strokes recorded elsewhere: a CSV of paths, pairs of photographs")
    imports.add_argument(
        "paths", type=Path, metavar="PATHS", help="CSV: stroke, t_s, x_mm, y_mm, z_mm (or press_mm), …"
    )
    imports.add_argument(
        "--photos", required=True, type=Path, metavar="FOLDER", help="with <stroke>_before.png and <stroke>_after.png"
    )
    place = imports.add_mutually_exclusive_group(required=True)
    place.add_argument(
        "--window", metavar="EDGES", help='what every photograph shows, such as "0 mm, 0 mm, 300 mm, 200 mm": '
        "left, lower, right and upper edge in the paths' frame",
    )  # fmt: skip
    place.add_argument(
        "--scale", metavar="SCALE", help='pixels over length, such as "5 px/mm": the lower left corner is 0, 0'
    )
    imports.add_argument("--y-down", action="store_true", help="y grows downwards in PATHS, from the photograph's top")
    imports.add_argument("--tool", required=True, metavar="NAME", help="that made the strokes")
    imports.add_argument("--out", required=True, type=Path, metavar="FOLDER", help="for the table and its card")
    imports.set_defaults(run=_import)

    card = commands.add_parser("card", help="what a table of strokes or pushes holds, and what it cannot tell")
    card.add_argument("rows", type=Path, metavar="ROWS", help="a Parquet file, or a folder of shards")
    card.add_argument("--out", type=Path, metavar="FILE", help="Markdown; by default beside the rows")
    card.set_defaults(run=_card)

    enough = commands.add_parser("enough", help="whether more strokes would make a better model: a learning curve")
    enough.add_argument("rows", type=Path, metavar="ROWS", help="strokes: a Parquet file, or a folder of shards")
    enough.add_argument("--seed", type=seed, default=0, help="of the shares and the bootstrap")
    enough.set_defaults(run=_enough)


def _import(arguments: argparse.Namespace) -> None:
    from pentimento.recordings.photo_pairs import import_photo_pairs
    from pentimento.recordings.place import Placement

    placement = Placement.parsed(arguments.window, arguments.scale, arguments.y_down)
    imported = import_photo_pairs(arguments.paths, arguments.photos, placement, arguments.tool, arguments.out)
    print(f"{imported.rows} strokes are in {arguments.out}.")
    for reason, strokes in imported.refused.items():
        print(f"Refused: {len(strokes)} × {reason} ({', '.join(strokes[:8])}{', …' if len(strokes) > 8 else ''}).")
    print(f"What they can tell: pentimento card {arguments.out}")


def _card(arguments: argparse.Namespace) -> None:
    with workshop("write a card"):
        from pentimento.recordings.card import write_card
    place, warnings = write_card(arguments.rows, arguments.out)
    for warning in warnings:
        print(warning)
    print(f"The card is {place}.")


def _enough(arguments: argparse.Namespace) -> None:
    with workshop("fit models"):
        from pentimento.recordings.learning_curve import learning_curve_of
    curve = learning_curve_of(arguments.rows, arguments.seed)
    for line in curve.lines():
        print(line)
    print(curve.sentence)
