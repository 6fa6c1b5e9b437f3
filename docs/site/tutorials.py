"""Run the tutorials and keep what they print and show: `python docs/site/tutorials.py [NAME ...]`, or `make tutorials`.

A tutorial is a Python file in jupytext's percent format. Its last cell makes `picture`, uint8 [H, W, 3], and an earlier
one `figure`, a number that the text explains. The site shows what is kept in `docs/tutorials/outputs/`.
"""

from __future__ import annotations

import io
import json
import re
import sys
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[2]
TUTORIALS: Final = ROOT / "docs/tutorials"
OUTPUTS: Final = TUTORIALS / "outputs"


@dataclass(frozen=True)
class Cell:
    """A part of a tutorial."""

    is_code: bool
    text: str
    line: int
    """Of the file, at which the text begins."""


def names() -> list[str]:
    """All tutorials, in their order."""
    return sorted(file.stem for file in TUTORIALS.glob("*.py"))


def cells(name: str) -> list[Cell]:
    """The cells of a tutorial; those of words without their comment signs."""
    found: list[Cell] = []
    lines = (TUTORIALS / f"{name}.py").read_text(encoding="utf-8").splitlines()
    starts = [number for number, line in enumerate(lines) if line.startswith("# %%")]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        is_code, body = lines[start] == "# %%", lines[start + 1 : end]
        text = "\n".join(body if is_code else [re.sub(r"^# ?", "", line) for line in body])
        found.append(Cell(is_code, text.rstrip(), start + 2))
    return found


def run(name: str) -> tuple[dict[str, Any], Any]:
    """Execute a tutorial from the project's folder: what is kept of it, and its picture."""
    space: dict[str, Any] = {"__name__": "__main__"}
    printed = []
    for cell in cells(name):
        if cell.is_code:
            code = compile("\n" * (cell.line - 1) + cell.text, str(TUTORIALS / f"{name}.py"), "exec")
            with redirect_stdout(io.StringIO()) as out:
                exec(code, space)
            printed.append(out.getvalue())
    return {"figure": space["figure"], "printed": printed}, space["picture"]


def kept(name: str) -> dict[str, Any]:
    """What was kept of a tutorial when it was run last."""
    return json.loads((OUTPUTS / f"{name}.json").read_text(encoding="utf-8"))


def page(name: str) -> str:
    """The tutorial as Markdown, with what it printed and its picture."""
    printed = iter(kept(name)["printed"])
    parts = []
    for cell in cells(name):
        parts.append(f"```python\n{cell.text}\n```" if cell.is_code else cell.text)
        if cell.is_code and (text := next(printed)):
            parts.append(f"```text\n{text.rstrip()}\n```")
    parts.append(f"![The picture of this tutorial](outputs/{name}.png)")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    from pentimento.contracts.images import write_png

    for chosen in sys.argv[1:] or names():
        result, picture = run(chosen)
        OUTPUTS.mkdir(exist_ok=True)
        (OUTPUTS / f"{chosen}.json").write_text(
            json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
        )
        write_png(OUTPUTS / f"{chosen}.png", picture)
        print(f"{chosen}: {result['figure']:.3f}")
