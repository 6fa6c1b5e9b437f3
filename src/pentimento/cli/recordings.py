"""`pentimento import`, `export`, `register`, `card` and `enough`; see docs/importing.md."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pentimento.cli import Command, given, option, seed, workshop
from pentimento.contracts.errors import ConfigError, UnitError
from pentimento.contracts.units import parse_quantity

if TYPE_CHECKING:
    from pentimento.io.lerobot_in import Description
    from pentimento.io.stroke_rows import Imported, Placement, RecordedPath

_NO_INK: Final = 1 / 3
"""Share of the strokes without ink along their paths, above which the import warns."""


def _import(arguments: argparse.Namespace) -> None:
    from pentimento.io.pen_files import SUFFIXES

    if arguments.paths.is_dir():
        from pentimento.io.lerobot_in import import_lerobot

        imported = import_lerobot(arguments.paths, _description_of_dataset(arguments), arguments.out)
    elif arguments.paths.suffix.lower() in SUFFIXES:
        imported = _import_pen(arguments)
    elif arguments.paths.suffix.lower() == ".npz":
        imported = _import_arrays(arguments)
    elif arguments.paths.suffix.lower() == ".parquet":
        raise ConfigError(
            f"{arguments.paths} is a table already: `pentimento card`, `enough` and `diagnose` read it as it is, and "
            f"`pentimento new tool NAME --like TOOL --source {arguments.paths}` brings it into the pipeline."
        )
    else:
        imported = _import_csv(arguments)
    print_imported(imported, arguments.out)
    if arguments.hand is None:
        print(f"What they hold: pentimento card {arguments.out}")


def print_imported(imported: Imported, out: Path) -> None:
    """Print how many strokes are in the table ``out``, which were refused and why, and where its contact sheet is."""
    from pentimento.io.contact_sheet import SHEET, SHOWN
    from pentimento.io.ink_along_path import NEAR_M

    print(f"{imported.rows} strokes are in {out}.")
    for reason, strokes in imported.refused.items():
        print(f"Refused: {len(strokes)} × {reason} ({', '.join(strokes[:8])}{', …' if len(strokes) > 8 else ''}).")
    if imported.without_ink > _NO_INK * imported.rows:
        print(
            f"{imported.without_ink} of {imported.rows} strokes have no ink within {1e3 * NEAR_M:g} mm of their paths: "
            "probably an axis or the unit is wrong. See --y-down, --scale and --window, and the units of the paths.",
            file=sys.stderr,
        )
    shown = f" (the first {SHOWN})" if imported.rows > SHOWN else ""
    print(f"Look at them before anything is trained: {out / SHEET}{shown}")


def _import_csv(arguments: argparse.Namespace) -> Imported:
    from pentimento.io.photo_pairs import import_photo_pairs
    from pentimento.io.stroke_videos import import_videos

    unwanted: tuple[str, ...] = ("action", "camera", "units", "y_up", "press", "hand")
    if arguments.video is not None:
        unwanted += ("scale", "blank")
        _needs(arguments, ("markers", "window", "tool"), unwanted=unwanted, of="A CSV of paths with --video")
        place, tool = _placement(arguments), arguments.tool
        return import_videos(arguments.paths, arguments.video, arguments.markers, place, tool, arguments.out)
    if arguments.page is not None:
        _needs(arguments, ("tool", *_with_markers(arguments)), unwanted=unwanted, of="A CSV of paths with --page")
        return _import_page(arguments, _placement(arguments), None)
    unwanted += ("blank", "markers")
    _needs(arguments, ("photos", "tool"), unwanted=unwanted, of="A CSV of paths without --page and --video")
    return import_photo_pairs(arguments.paths, arguments.photos, _placement(arguments), arguments.tool, arguments.out)


def _with_markers(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the options that a picture with markers needs."""
    return () if arguments.markers is None else ("window",)


def _import_page(arguments: argparse.Namespace, placement: Placement, strokes: list[RecordedPath] | None) -> Imported:
    from pentimento.io.scanned_page import import_page

    return import_page(
        arguments.paths,
        arguments.page,
        arguments.blank,
        placement,
        arguments.tool,
        arguments.out,
        markers=arguments.markers,
        strokes=strokes,
    )


def _import_pen(arguments: argparse.Namespace) -> Imported:
    from pentimento.io.pen_files import commanded, import_demonstrations, read_pen
    from pentimento.io.photo_pairs import import_photo_pairs

    unwanted: tuple[str, ...] = ("action", "camera", "video")
    pictures = arguments.photos is not None or arguments.page is not None
    if pictures:
        unwanted += ("hand",) if arguments.page is not None else ("hand", "blank", "markers")
        _needs(
            arguments,
            ("tool", *_with_markers(arguments)),
            unwanted=unwanted,
            of=f"{arguments.paths} with pictures",
        )
    else:
        unwanted += ("blank", "markers", "tool", "window", "scale", "press")
        of = f"{arguments.paths} without --page and --photos, which becomes demonstrations,"
        _needs(arguments, ("hand",), unwanted=unwanted, of=of, placed=False)
    pen = read_pen(arguments.paths, _unit_m(arguments), _y_down(arguments))
    for sentence in pen.assumed:
        print(sentence)
    if not pictures:
        return import_demonstrations(arguments.paths, pen, arguments.hand, arguments.out)
    strokes = commanded(pen, _press_m(arguments), arguments.paths)
    placement = _placement(arguments)._replace(y_down=pen.y_down)
    if arguments.page is not None:
        return _import_page(arguments, placement, strokes)
    return import_photo_pairs(
        arguments.paths, arguments.photos, placement, arguments.tool, arguments.out, strokes=strokes
    )


def _import_arrays(arguments: argparse.Namespace) -> Imported:
    from pentimento.io.pair_arrays import import_pair_arrays, read_pairs

    unwanted = ("photos", "page", "blank", "video", "markers", "action", "camera", "hand")
    _needs(arguments, ("tool", "units"), unwanted=unwanted, of=f"{arguments.paths}, arrays with pictures,")
    pairs = read_pairs(arguments.paths, _unit_m(arguments) or 1.0, _press_m(arguments))
    way, other = ("down", "--y-up") if arguments.y_down else ("up", "--y-down")
    for sentence in (*pairs.assumed, f"y points {way}; else give {other}."):
        print(sentence)
    return import_pair_arrays(arguments.paths, pairs, _placement(arguments), arguments.tool, arguments.out)


def _y_down(arguments: argparse.Namespace) -> bool | None:
    return None if not (arguments.y_down or arguments.y_up) else bool(arguments.y_down)


def _unit_m(arguments: argparse.Namespace) -> float | None:
    """Return the length of the unit that `--units` names: mm, or 0.01 mm."""
    if arguments.units is None:
        return None
    text = arguments.units if any(character.isdigit() for character in arguments.units) else f"1 {arguments.units}"
    try:
        length_m = parse_quantity(text, "m")
    except UnitError as error:
        raise ConfigError(f"--units {arguments.units} is no unit of length: {error}") from error
    if not length_m > 0:
        raise ConfigError(f"--units {arguments.units} is not above zero; write one such as '0.01 mm'.")
    return length_m


def _press_m(arguments: argparse.Namespace) -> float | None:
    if arguments.press is None:
        return None
    try:
        return parse_quantity(arguments.press, "m")
    except UnitError as error:
        raise ConfigError(f"--press {arguments.press} is no length: {error}") from error


def _description_of_dataset(arguments: argparse.Namespace) -> Description | None:
    """Return the description of a dataset given by the options; None where none is given."""
    from pentimento.io.lerobot_in import Description

    unwanted = ("photos", "page", "blank", "video", "markers", "y_up", "press", "hand")
    options = ("tool", "window", "scale", "y_down", "action", "camera", "units", *unwanted)
    if not any(getattr(arguments, name) for name in options):
        return None
    _needs(arguments, ("tool",), unwanted=unwanted, of="A LeRobot dataset that was not exported from strokes")
    unit_m = _unit_m(arguments) or 1.0
    return Description(_placement(arguments), arguments.tool, unit_m, arguments.action, arguments.camera)


def _needs(
    arguments: argparse.Namespace, needed: tuple[str, ...], *, unwanted: tuple[str, ...], of: str, placed: bool = True
) -> None:
    missing = [f"--{name}" for name in needed if getattr(arguments, name) is None]
    if placed and "window" not in needed and arguments.window is None and arguments.scale is None:
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


def _register(arguments: argparse.Namespace) -> None:
    with workshop("register strokes"):
        from pentimento.dynamics.strokes.registration import register
    from pentimento.contracts.atomic import command_folder
    from pentimento.contracts.strokes import CONTRACT
    from pentimento.contracts.tables import read_table, write_shards

    checked = read_table(arguments.rows, CONTRACT)
    if checked.quarantined:
        print(f"{len(checked.quarantined)} rows break the contract and are left out.")
    registered = register(checked.table)
    with command_folder(arguments.out, "pentimento register") as folder:
        write_shards(folder, registered.table, CONTRACT)
        (folder / "README.md").write_text(f"# Registered strokes\n\n{registered.sentence}\n", encoding="utf-8")
    print(registered.sentence)


def _card(arguments: argparse.Namespace) -> None:
    with workshop("write a card"):
        from pentimento.io.card import write_card
    place, warnings = write_card(arguments.rows, arguments.out)
    for warning in warnings:
        print(warning)
    print(f"The card is {place}.")
    if arguments.sheet is not None:
        _write_sheet(arguments.rows, arguments.sheet)
        print(f"The first strokes are shown in {arguments.sheet}.")


def _write_sheet(rows: Path, sheet: Path) -> None:
    """Write the contact sheet of the first strokes of a table as a PNG."""
    from pentimento.contracts.images import write_png
    from pentimento.contracts.strokes import CONTRACT
    from pentimento.contracts.tables import read_table
    from pentimento.io.contact_sheet import contact_sheet, shown_strokes

    write_png(sheet, contact_sheet(shown_strokes(read_table(rows, CONTRACT).table)))


def _enough(arguments: argparse.Namespace) -> None:
    with workshop("fit models"):
        from pentimento.dynamics.strokes.learning_curve import learning_curve_of
    curve, sampling = learning_curve_of(arguments.rows, arguments.seed)
    print(sampling.sentence)
    for line in curve.lines():
        print(line)
    print(curve.sentence)
    print("This is of the base model; a diagnosis wants at least a hundred strokes, some of them made twice or more.")


_ROWS = option("rows", type=Path, metavar="ROWS", help="strokes: a Parquet file, or a folder of shards")

COMMANDS = (
    Command(
        "import",
        "recorded strokes: a CSV of paths with pictures or videos, both in an .npz, pen strokes (InkML, UNIPEN, SVG), "
        "a LeRobot dataset",
        (
            option(
                "paths",
                type=Path,
                metavar="PATHS",
                help="CSV: stroke, t_s, x_mm, y_mm, z_mm (or press_mm), …; .npz with path, before, after; pen strokes: "
                ".inkml, .svg or .unipen (.upn, .unp, .dat); or the folder of a LeRobot v3.0 dataset",
            ),
            option(
                "--photos",
                type=Path,
                metavar="FOLDER",
                exclusive="pictures",
                help="with <stroke>_before.png and <stroke>_after.png; pen strokes are named 0, 1, 2, …",
            ),
            option(
                "--page",
                type=Path,
                metavar="FILE",
                exclusive="pictures",
                help="one picture of the page after all its strokes, in place of --photos",
            ),
            option("--blank", type=Path, metavar="FILE", help="with --page: the page before the first stroke"),
            option(
                "--video",
                type=Path,
                metavar="PLACE",
                exclusive="pictures",
                help="for a CSV: a folder with <stroke>.mp4, or the video of its only stroke, by a camera that stays",
            ),
            option(
                "--markers",
                type=Path,
                metavar="FILE",
                help="CSV marker, x_mm, y_mm, side_mm of four or more ArUco markers, which rectify --video or --page",
            ),
            option("--hand", metavar="NAME", help="who drew pen strokes without pictures: they become demonstrations"),
            option(
                "--press",
                metavar="LENGTH",
                help="of pen strokes with pictures: how deep, at full pressure; of .npz: where z is 1",
            ),
            option(
                "--action",
                metavar="NAMES",
                help='of a dataset: which values of its actions are x, y, z and yaw; "x,y,z,yaw"',
            ),
            option("--camera", metavar="FEATURE", help="of a dataset: which feature shows the canvas"),
            option(
                "--units",
                metavar="UNIT",
                help="of length, of a dataset (metres by default), of pen strokes or of .npz: mm, or '0.01 mm'",
            ),
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
            option(
                "--y-down",
                action="store_true",
                exclusive="y",
                help="y grows downwards in PATHS, from the photograph's top",
            ),
            option("--y-up", action="store_true", exclusive="y", help="y grows upwards in pen strokes and .npz"),
            option("--tool", metavar="NAME", help="that made the strokes"),
            option(
                "--out", required=True, type=Path, metavar="FOLDER", help="for the table, README.md and contact sheet"
            ),
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
        "register",
        "strokes of a person's hand whose paths are moved onto their ink, one by one; not for a robot's strokes",
        (_ROWS, option("--out", required=True, type=Path, metavar="FOLDER", help="for the table")),
        _register,
    ),
    Command(
        "card",
        "the data card of a table of strokes or pushes: what it holds, and which causes it cannot show",
        (
            option("rows", type=Path, metavar="ROWS", help="a Parquet file, or a folder of shards"),
            option("--out", type=Path, metavar="FILE", help="Markdown; by default next to the rows"),
            option("--sheet", type=Path, metavar="FILE", help="PNG of the first strokes, each with its path"),
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
