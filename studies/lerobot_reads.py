"""Whether the real `lerobot` reads what is exported, and writes what is imported.

`lerobot` bounds the versions of packages, so that it needs an environment of its own:

    python3 -m venv ENV && ENV/bin/pip install 'lerobot[dataset]'
    python -m studies.lerobot_reads --lerobot ENV/bin/python

Strokes of the contract are exported. LeRobot's `LeRobotDataset` must read their actions and pictures, and what its
tools make of them (`merge_datasets`, `delete_episodes`) must be imported. Then LeRobot records a dataset with images
and one with videos in its default codec, AV1 (extra `video`); both are imported. Exit status 1 where anything differs.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pentimento.contracts.frames import crop
from pentimento.contracts.images import decode_png
from pentimento.contracts.strokes import CONTRACT, example_table
from pentimento.contracts.tables import read_table
from pentimento.io.lerobot_in import Description, import_lerobot
from pentimento.io.lerobot_out import export_lerobot, frame_times, resampled
from pentimento.io.stroke_rows import Placement

STROKES, FPS, FRAMES = 6, 30, 9
SIDE: Final = Path(__file__).with_name("lerobot_side.py")
DESCRIPTION: Final = Description(Placement.parsed("0 mm, 0 mm, 400 mm, 280 mm", None, False), "pen", 1.0, None, None)
"""A window of the pictures' proportions that holds every path of the example."""
_BRIGHTER: Final = 0.06
"""What a picture gains from frame to frame, of its white: frames are told apart by their brightness."""
_CODING: Final = 4.0
"""Max mean error of a picture of a video, of 255: a third of that step."""


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.lerobot_reads", description=__doc__)
    parser.add_argument("--lerobot", type=Path, required=True, help="Python of an environment with lerobot")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        faults = reads(args.lerobot, Path(temporary)) + writes(args.lerobot, Path(temporary))
        version = lerobot(args.lerobot, "version").strip()
    print("\n".join(faults) or f"LeRobot {version} reads what was exported, and what it wrote was imported, AV1 too.")
    return 1 if faults else 0


def lerobot(python: Path, *what: str | Path) -> str:
    """What the other side prints; it sees the packages of its own environment alone.

    Raises:
        SystemExit: it failed; its last words.
    """
    done = subprocess.run([python, "-I", SIDE, *what], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"LeRobot failed at: {' '.join(map(str, what))}\n{done.stderr[-4000:]}")
    return done.stdout


def reads(python: Path, folder: Path) -> list[str]:
    """What LeRobot reads of an export otherwise than it was written, and what is lost by its tools: a sentence each."""
    table = example_table(STROKES)
    roots = [folder / "one", folder / "other"]
    for root in roots:
        pq.write_table(table, folder / "rows.parquet")
        export_lerobot(folder / "rows.parquet", root, FPS)
    lerobot(python, "read", roots[0], folder / "read.npz")
    with np.load(folder / "read.npz") as seen:
        faults = differences(seen, table)
    lerobot(python, "merge", *roots, folder / "merged")
    merged, twice = imported(folder / "merged", None), pa.concat_tables([table, table])
    other = [name for name in table.column_names if as_text(merged[name]) != as_text(twice[name])]
    if other:
        faults.append(f"Two exports that LeRobot merged are imported with other values of {', '.join(other)}.")
    lerobot(python, "delete", roots[0], folder / "fewer")
    if imported(folder / "fewer", DESCRIPTION).num_rows != STROKES - 1:
        faults.append("An export without its first episode has not one stroke less.")
    return faults


def as_text(column: pa.ChunkedArray) -> str:
    """The values of a column; unknown ones are equal, whether NaN or null, which LeRobot's merging makes of NaN."""
    return str(column.to_pylist()).replace("None", "nan")


def differences(seen: Any, table: pa.Table) -> list[str]:
    """What was read otherwise than a table of strokes was exported: a sentence each."""
    faults, rows = [], table.to_pylist()
    if len(np.unique(seen["episode"])) != len(rows):
        return [f"{len(np.unique(seen['episode']))} episodes were read, and {len(rows)} written."]
    for number, row in enumerate(rows):
        own = seen["episode"] == number
        path = np.array(row["path"])
        commanded = resampled(path, frame_times(path, FPS))
        if not np.array_equal(seen["action"][own], commanded.astype(np.float32)):
            faults.append(f"Episode {number} has other actions.")
        for at, when in ((0, "before"), (-1, "after")):
            picture = decode_png(row[when]["bytes"])
            height, width = picture.shape[:2]
            if not np.array_equal(seen["picture"][own][at, :height, :width], picture):
                faults.append(f"Episode {number} has another picture {when}.")
        if set(seen["task"][own]) != {f"Paint one stroke with the {row['tool']}."}:
            faults.append(f"Episode {number} has another task.")
    return faults


def writes(python: Path, folder: Path) -> list[str]:
    """What is imported of datasets that LeRobot records otherwise than it was recorded: a sentence each."""
    action, picture = recording()
    frames = {name: value.reshape(-1, *value.shape[2:]) for name, value in (("action", action), ("picture", picture))}
    np.savez(folder / "frames.npz", episode=np.repeat(np.arange(STROKES), FRAMES), **frames)
    faults, whole = [], np.array(DESCRIPTION.placement.window_m(picture.shape[2:4]))
    for kind, within in (("image", 0.0), ("video", _CODING)):
        lerobot(python, f"record-{kind}", folder / "frames.npz", folder / kind)
        rows = imported(folder / kind, DESCRIPTION).to_pylist()
        if len(rows) != STROKES:
            faults.append(f"{len(rows)} of {STROKES} episodes with {kind}s were imported.")
        for row in rows:
            number = row["order"]
            if not np.allclose(np.array(row["path"])[:, 1:], action[number], atol=1e-6):
                faults.append(f"Episode {number} with {kind}s has another path.")
            if not np.allclose(np.array(row["path"])[:, 0], np.arange(FRAMES) / FPS, atol=1e-6):
                faults.append(f"Episode {number} with {kind}s has other times.")
            for at, when in ((0, "before"), (-1, "after")):
                own = crop(picture[number, at], whole, np.array(row["window_m"]))
                away = np.abs(decode_png(row[when]["bytes"]).astype(float) - own).mean()
                if away > within:
                    faults.append(f"Episode {number} with {kind}s has another picture {when}, by {away:.1f}.")
    return faults


def recording() -> tuple[np.ndarray, np.ndarray]:
    """Actions [E, F, 4] and pictures [E, F, H, W, 3] of strokes; each frame's picture is another."""
    rows = example_table(STROKES).to_pylist()
    shown = np.array([[decode_png(row[when]["bytes"]) for when in ("before", "after")] for row in rows], dtype=float)
    shown = shown[:, [0] * (FRAMES - 1) + [1]]
    brightness = 0.3 + _BRIGHTER * np.arange(FRAMES) + 0.02 * np.arange(STROKES)[:, None]
    picture = (brightness[..., None, None, None] * shown).astype(np.uint8)
    at = [np.array(row["path"])[np.linspace(0, len(row["path"]) - 1, FRAMES).astype(int), 1:] for row in rows]
    return np.array(at, dtype=np.float32), picture


def imported(folder: Path, description: Description | None) -> pa.Table:
    """The rows of a dataset."""
    out = folder.with_name(f"{folder.name}_rows")
    import_lerobot(folder, description, out)
    return read_table(out, CONTRACT).table.combine_chunks()


if __name__ == "__main__":
    sys.exit(main())
