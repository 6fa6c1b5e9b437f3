"""`pentimento import` of a LeRobot dataset: episodes become strokes.

A dataset that `pentimento export` wrote keeps its rows in `meta/episodes`. In any other dataset, an episode is one
stroke: its actions are the path, its first picture shows the canvas before it and its last picture the canvas after it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts.atomic import check_replaceable
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import encode_png
from pentimento.contracts.schema import IMAGE
from pentimento.contracts.strokes import CONTRACT
from pentimento.io.contact_sheet import shown_strokes, write_with_sheet
from pentimento.io.lerobot_episodes import (
    Episode,
    Reasons,
    first_and_last_pictures,
    leave_out,
    sound_episodes,
)
from pentimento.io.lerobot_folder import (
    ACTION,
    CANVAS,
    OWN,
    OWN_PICTURE,
    PICTURES,
    Dataset,
    names_of,
    open_dataset,
)
from pentimento.io.stroke_rows import (
    COMMAND,
    Imported,
    Placement,
    RecordedPath,
    Refused,
    card,
    counted,
    path_fault,
    stroke_row,
    table_of,
)

_PLACE: Final = ("x", "y", "z")
_YAW: Final = "yaw"


class Description(NamedTuple):
    """What a foreign dataset does not describe itself."""

    placement: Placement
    """Where its pictures, which are rectified, lie on the canvas."""
    tool: str
    unit_m: float
    """Its unit of length, in metres."""
    action: str | None
    """Which values of an action are x, y, z and optionally yaw: names or indices from 0, separated by commas."""
    camera: str | None
    """The feature with pictures of the canvas; None where the dataset has only one."""


def import_lerobot(folder: Path, description: Description | None, out: Path) -> Imported:
    """Write the folder ``out`` as shards of the strokes contract, with a README that counts refused episodes.

    Args:
        description: None for a dataset that was exported from strokes.

    Raises:
        ConfigError: ``description`` is missing, is given for an exported dataset, or names what the dataset lacks; or
            ``out`` holds what this command did not write.
        ContractError: the dataset cannot be read, or no episode can be used; nothing is written.
    """
    check_replaceable(out, COMMAND)
    dataset = open_dataset(folder)
    if dataset.exported and description is not None:
        raise ConfigError(f"{folder} was exported from strokes and describes them itself; give --out alone.")
    if not dataset.exported and description is None:
        raise ConfigError(
            f"{folder} does not say what made its strokes and where its pictures lie; give --tool, and --window or "
            "--scale."
        )
    refused: Reasons = {}
    table = _kept_rows(dataset, refused) if description is None else _episode_rows(dataset, description, refused)
    if table.num_rows == 0:
        raise ContractError(
            f"None of the {dataset.episodes.num_rows} episodes of {folder} can be used: {counted(refused)}."
        )
    name, tools = folder.resolve().name, ", ".join(sorted({str(tool) for tool in table["tool"].to_pylist()}))
    write_with_sheet(out, table, CONTRACT, card(name, tools, table.num_rows, refused), shown_strokes)
    return Imported(table.num_rows, refused)


def _kept_rows(dataset: Dataset, refused: Reasons) -> pa.Table:
    """Return the exported rows: every column unchanged, and the pictures without their padding."""
    heights, widths, grey = (dataset.whole_numbers(f"{OWN_PICTURE}{name}") for name in ("height", "width", "grey"))
    pictures: dict[int, tuple[bytes, bytes]] = {}
    for file, _, episodes in sound_episodes(dataset, [], refused):
        for episode, pair in first_and_last_pictures(dataset, _camera(dataset, CANVAS), file, episodes, refused):
            height, width = heights[episode.place], widths[episode.place]
            if not (0 < height <= pair[0].shape[0] and 0 < width <= pair[0].shape[1]):
                leave_out(refused, "its pictures are smaller than the exported ones", [episode.number])
                continue
            channels = 0 if grey[episode.place] else slice(None)
            before, after = (encode_png(picture[:height, :width, channels]) for picture in pair)
            pictures[episode.place] = before, after
    places = sorted(pictures)
    rows = dataset.episodes.take(pa.array(places, pa.int64()))
    rows = rows.select([name for name in rows.column_names if name.startswith(OWN)])
    rows = rows.rename_columns([name.removeprefix(OWN) for name in rows.column_names])
    for at, name in enumerate(("before", "after")):
        values = [{"bytes": pictures[place][at], "path": None} for place in places]
        rows = rows.append_column(pa.field(name, IMAGE), pa.array(values, IMAGE))
    return rows


def _episode_rows(dataset: Dataset, description: Description, refused: Reasons) -> pa.Table:
    """Return one row for each episode."""
    camera, axes = _camera(dataset, description.camera), _axes(dataset, description.action)
    session = dataset.folder.resolve().name
    rows = []
    for file, columns, episodes in sound_episodes(dataset, ["timestamp", ACTION], refused):
        strokes: dict[int, RecordedPath] = {}
        for episode in episodes:
            stroke = _recorded(episode, columns, axes, description.unit_m)
            if stroke.fault is None:
                strokes[episode.place] = stroke
            else:
                leave_out(refused, stroke.fault, [episode.number])
        sound = [episode for episode in episodes if episode.place in strokes]
        for episode, pair in first_and_last_pictures(dataset, camera, file, sound, refused, columns["timestamp"]):
            number = episode.number
            given = {"session": session, "order": number, "action_id": number, "tool": description.tool}
            try:
                rows.append(stroke_row(strokes[episode.place], *pair, description.placement, given))
            except Refused as reason:
                leave_out(refused, reason, [number])
    return table_of(sorted(rows, key=lambda row: int(row["order"])), [])


def _recorded(
    episode: Episode, columns: dict[str, NDArray[np.float64]], axes: list[int], unit_m: float
) -> RecordedPath:
    action, name = columns[ACTION], str(episode.number)
    path = np.zeros((len(episode.rows), 5))
    if action.ndim != 2 or max(axes) >= action.shape[1] or columns["timestamp"].ndim != 1:
        return RecordedPath(name, path, {}, "its actions or times are not of the shape that info.json says")
    values = action[episode.rows][:, axes]
    if np.isinf(values).any() or np.isinf(columns["timestamp"][episode.rows]).any():
        return RecordedPath(name, path, {}, "a point is NaN or infinite")
    path[:, 0] = columns["timestamp"][episode.rows]
    path[:, 0] -= path[0, 0]
    path[:, 1:4] = unit_m * values[:, :3]
    if len(axes) > len(_PLACE):
        path[:, 4] = values[:, 3]
    return RecordedPath(name, path, {}, path_fault(path))


def _camera(dataset: Dataset, asked: str | None) -> str:
    cameras = [key for key, feature in dataset.features.items() if feature["dtype"] in PICTURES]
    if asked is None and len(cameras) == 1:
        return cameras[0]
    if asked is None or asked not in cameras:
        wanted = "has several features with pictures" if asked is None else f"has no feature {asked!r} with pictures"
        there = ", ".join(map(repr, cameras)) or "none"
        raise ConfigError(f"{dataset.folder} {wanted}; choose by --camera which shows the canvas: {there}.")
    return asked


def _axes(dataset: Dataset, asked: str | None) -> list[int]:
    """Return the indices of x, y, z and optionally yaw in an action."""
    feature = dataset.features.get(ACTION)
    if feature is None or feature["dtype"] in PICTURES or len(feature["shape"]) != 1:
        raise ContractError(f"{dataset.folder} has no feature {ACTION!r} that is a vector, and so no paths of strokes.")
    names, (width,) = names_of(feature) or [], feature["shape"]
    if asked is None:
        wanted = [*_PLACE, *([_YAW] if _YAW in names else [])]
    else:
        wanted = [name.strip() for name in asked.split(",")]
    at = [names.index(name) if name in names else _number(name, width) for name in wanted]
    known = [place for place in at if place is not None]
    if len(known) < len(wanted) or len(wanted) not in (3, 4) or len(set(known)) < len(known):
        there = f"its names are {', '.join(map(repr, names))}" if names else "it has no names"
        raise ConfigError(
            f"{dataset.folder}: {', '.join(wanted)} are not three or four values of an {ACTION}; say by --action "
            f"which are x, y, z and perhaps yaw: {there}, its numbers 0 to {width - 1}."
        )
    return known


def _number(name: str, width: int) -> int | None:
    return int(name) if name.isascii() and name.isdecimal() and len(name) < 6 and int(name) < width else None
