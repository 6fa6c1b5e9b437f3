"""`pentimento record`: strokes on printed sheets, photographed with a phone; see docs/new_brush.md."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pentimento.cli import Command, count, option, seed


def _sheet(arguments: argparse.Namespace) -> None:
    from pentimento.collection.recording_sheet import COMMANDS, write_recording
    from pentimento.robots.tools import load_tool

    tool = load_tool(arguments.tool)
    folder: Path = arguments.out
    recording = write_recording(folder, tool, arguments.strokes, arguments.seed)
    dips = " Load it with the same paint where DIP is written." if tool.dips else ""
    print(
        f"""{arguments.strokes} strokes are on {recording.sheets} sheets in {folder / "sheets.pdf"}.
1. Print it in colour on A4, at 100 %, and measure the bar of 100 mm.
2. Tape each sheet flat, and photograph it blank: the whole sheet, from above, in even light.
3. Paint in the order of the numbers, from each cross to its arrow head.{dips}
   A rig paints the paths in {folder / COMMANDS} instead: origin at the small cross that is lowest on the left.
4. Photograph each sheet again, from about the same place.
5. pentimento record read {folder} --before BLANK.jpg … --after PAINTED.jpg … --out TABLE"""
    )


def _read(arguments: argparse.Namespace) -> None:
    from pentimento.cli.recordings import print_imported
    from pentimento.io.photographed_sheets import read_sheets

    found = read_sheets(arguments.recording, arguments.before, arguments.after, arguments.out)
    red, green, blue = (round(255 * float(channel)) for channel in found.color_srgb)
    print_imported(found.imported, arguments.out)
    print(f"The paint is #{red:02x}{green:02x}{blue:02x}.")
    if not found.coloured:
        print("The chart is not printed in its colours, so colours are corrected by the white of the paper alone.")


_PHOTOGRAPHS: dict[str, Any] = {"type": Path, "nargs": "+", "required": True, "metavar": "PHOTO"}

COMMAND = Command(
    "record",
    "record strokes with a printer and a phone: print sheets, paint, photograph, read",
    subcommands=(
        Command(
            "sheet",
            "write sheets to print and paint on, and the commands",
            (
                option("--tool", required=True, metavar="TOOL", help="name or file of the tool"),
                option("--strokes", type=count, default=60, metavar="N", help="15 on each sheet; 60 by default"),
                option("--seed", type=seed, default=0, metavar="N", help="of the design"),
                option("--out", required=True, type=Path, metavar="FOLDER", help="for the recording"),
            ),
            _sheet,
        ),
        Command(
            "read",
            "make a table of strokes from photographs of the sheets",
            (
                option("recording", type=Path, metavar="FOLDER", help="that `pentimento record sheet` wrote"),
                option("--before", help="of each blank sheet, in any order", **_PHOTOGRAPHS),
                option("--after", help="of each painted sheet, in any order", **_PHOTOGRAPHS),
                option("--out", required=True, type=Path, metavar="TABLE", help="folder for the table"),
            ),
            _read,
        ),
    ),
)
