"""The report's section on the sheet that a person and the robot drew in turns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pentimento.report.files import incomplete, read_bytes, read_json
from pentimento.report.html import Album
from pentimento.report.templates import render
from pentimento.report.wording import decimal, tool_name


@dataclass(frozen=True, eq=False)
class DuetInputs:
    """What the stage `duet` wrote; pictures are PNG."""

    tool: str
    turns: list[dict[str, Any]]
    """By turn: `asked`, `strokes` of `person` and `robot`, `error` of `no_change` and `drawn`."""
    strip: bytes
    """All turns side by side."""
    sheet: bytes
    """The photograph at the end."""


def read_duet(folder: Path) -> DuetInputs:
    """Read the folder that the stage `duet` wrote.

    Raises:
        ContractError: a file is missing or lacks an entry.
    """
    metrics = read_json(folder / "metrics.json")
    try:
        for turn in metrics["turns"]:
            _row(1, turn)
        return DuetInputs(
            metrics["tool"], metrics["turns"], read_bytes(folder / "turns.png"), read_bytes(folder / "sheet.png")
        )
    except (KeyError, TypeError) as error:
        raise incomplete(folder, error, "duet") from error


def duet_section(inputs: DuetInputs, album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    return render(
        "report/duet.html",
        album=album,
        duet=inputs,
        tool=tool_name(inputs.tool),
        rows=[_row(number, turn) for number, turn in enumerate(inputs.turns, 1)],
    )


def _row(number: int, turn: dict[str, Any]) -> list[str]:
    strokes, error = turn["strokes"], turn["error"]
    figures = [decimal(error["no_change"]), decimal(error["drawn"])]
    return [f"{number}: “{turn['asked']}”", str(strokes["person"]), str(strokes["robot"]), *figures]
