"""`pentimento import`: paths in a CSV file and a photograph before and after each stroke become a strokes table."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.images import read_image
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import write_table
from pentimento.io.path_table import each_about, read_paths
from pentimento.io.place import Placement
from pentimento.io.stroke_rows import MAX_PIXELS, Imported, Refused, card, counted, stroke_row, table_of

_ENDINGS: Final = (".png", ".jpg", ".jpeg")


def import_photo_pairs(paths: Path, photos: Path, placement: Placement, tool: str, out: Path) -> Imported:
    """Write the folder ``out`` as shards of the strokes contract with a card that counts what was refused.

    A stroke without its own ``session``, ``order`` or ``action_id`` gets ``paths``' name, its place in the file and an
    action of its own: repeats of one command are known only where ``action_id`` says so. Photographs are rectified to
    ``placement`` already, ``<stroke>_before.png`` and ``<stroke>_after.png``; each row keeps what lies around its path.

    Raises:
        ContractError: the file of paths cannot be read, or no stroke of it can be used; nothing is written.
    """
    strokes = read_paths(paths)
    rows: list[dict[str, Any]] = []
    refused: dict[str, list[str]] = {}
    first: dict[str, int] = {}
    for number, stroke in enumerate(strokes):
        given = {"session": paths.stem, "order": number, "action_id": number, "tool": tool}
        try:
            if stroke.fault is not None:
                raise Refused(stroke.fault)
            before, after = (_photo(photos, f"{stroke.name}_{when}") for when in ("before", "after"))
            row = stroke_row(stroke, before, after, placement, given)
            if row["action_id"] in first and len(strokes[first[row["action_id"]]].path) != len(stroke.path):
                raise Refused("its action_id is that of a stroke with another number of points")
        except Refused as reason:
            refused.setdefault(str(reason), []).append(stroke.name)
            continue
        first.setdefault(row["action_id"], number)
        rows.append(row)
    if not rows:
        raise ContractError(f"None of the {len(strokes)} strokes of {paths} can be used: {counted(refused)}.")
    table = table_of(rows, list(each_about(strokes)))
    write_table(out, table, CONTRACT, card(paths.name, tool, len(rows), refused))
    return Imported(len(rows), refused)


def _photo(folder: Path, stem: str) -> NDArray[np.uint8]:
    found = next((folder / f"{stem}{end}" for end in _ENDINGS if (folder / f"{stem}{end}").is_file()), None)
    if found is None:
        raise Refused(f"there is no photograph {'before' if stem.endswith('_before') else 'after'} it")
    try:
        image = read_image(found)
    except PentimentoError as error:
        raise Refused("a photograph is unreadable") from error
    if image.shape[0] * image.shape[1] > MAX_PIXELS:
        raise Refused("a photograph is larger than 128 megapixels")
    return image
