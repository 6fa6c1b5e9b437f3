"""Files of pen strokes for tests: the same known strokes as InkML, UNIPEN and SVG."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.cli.main import main
from pentimento.contracts.demonstrations import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.handwriting.recording import to_source

FloatArray = NDArray[np.float64]

STROKES_MM = [
    np.array([[20.0, 30.5], [25.25, 33.0], [31.5, 31.25], [40.0, 28.0]]),
    np.array([[50.0, 60.0], [50.5, 52.0], [55.75, 45.5]]),
]
"""x, y (up)."""
STEP_MS = 20
INKML = "http://www.w3.org/2003/InkML"


def traces(columns: Sequence[FloatArray]) -> str:
    return "".join(
        f"<trace>{', '.join(' '.join(f'{value:g}' for value in point) for point in each)}</trace>" for each in columns
    )


def inkml(folder: Path, content: str) -> Path:
    return saved(folder / "ink.inkml", f'<ink xmlns="{INKML}">{content}</ink>')


def unipen(folder: Path, strokes: Sequence[FloatArray], coord: str, head: str) -> Path:
    parts = [f".VERSION 1.0\n{head}\n.COORD {coord}\n.SEGMENT WORD 0:2 OK?"]
    for each in strokes:
        parts += [".PEN_DOWN", *(" ".join(f"{value:g}" for value in point) for point in each), ".PEN_UP"]
    return saved(folder / "pen.unipen", "\n".join(parts) + "\n")


def svg(folder: Path, strokes: Sequence[FloatArray], size: str) -> Path:
    lines = "".join(
        f'<polyline points="{" ".join(f"{x:g},{y:g}" for x, y in each)}" stroke="#000" fill="none"/>'
        for each in strokes
    )
    return saved(folder / "drawing.svg", f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{lines}</svg>')


def saved(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def demonstrations(path: Path, *options: str) -> list[FloatArray]:
    """Import a file as demonstrations; the points [K, 5] of each in the frame of the recording."""
    out = path.parent / "demonstrations"
    assert main(["import", str(path), "--hand", "ann", "--out", str(out), *options]) == 0
    rows = read_table(out, CONTRACT).table.to_pylist()
    assert {row["hand"] for row in rows} == {"ann"} and (out / "contact_sheet.png").is_file()
    return [to_source(np.array(row["points"]), np.array(row["standard_to_source"])) for row in rows]


def assert_places(found: Sequence[FloatArray], expected_mm: Sequence[FloatArray]) -> None:
    """To a micrometre."""
    assert len(found) == len(expected_mm)
    for points, expected in zip(found, expected_mm, strict=True):
        np.testing.assert_allclose(points[:, 1:3], 1e-3 * expected, rtol=0, atol=1e-6)
