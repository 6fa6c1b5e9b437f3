"""The causes that docs/diagnosis.md describes."""

import re
from pathlib import Path

_PAGE = Path(__file__).parents[2] / "docs/diagnosis.md"


def documented_causes(kind: str) -> list[str]:
    """The names in the first column of the table of section 12 for `strokes` or `pushes`."""
    table = _PAGE.read_text(encoding="utf-8").partition(f"| {kind} | definition |")[2].partition("\n\n")[0]
    return [
        name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1] if "|" in row else "")
    ]
