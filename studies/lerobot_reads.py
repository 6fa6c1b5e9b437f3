"""Whether the real `lerobot` opens an exported dataset: `python -m studies.lerobot_reads --lerobot ENV/bin/python`.

`lerobot` has bounds of its own on PyTorch and datasets, so it needs an environment of its own:
`python3 -m venv ENV && ENV/bin/pip install lerobot`. The script exports strokes of the contract, then compares what
LeRobot's own `LeRobotDataset` reads with them: episodes, frames, actions and pictures. Exit status 1 where they differ.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from pentimento.contracts.strokes import example_table
from pentimento.io.lerobot_out import export_lerobot

STROKES, FPS = 6, 30
READER = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
dataset = LeRobotDataset("local/strokes", root=sys.argv[1])
frames = [dataset[number] for number in range(len(dataset))]
print(json.dumps({
    "episodes": dataset.num_episodes,
    "frames": len(dataset),
    "actions": [frame["action"].tolist() for frame in frames],
    "episode": [int(frame["episode_index"]) for frame in frames],
    "picture": list(frames[0]["observation.images.canvas"].shape),
    "task": frames[0]["task"],
}))
"""
"""Runs in LeRobot's environment."""


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.lerobot_reads", description=__doc__)
    parser.add_argument("--lerobot", type=Path, required=True, help="Python of an environment with lerobot")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        rows, folder = Path(temporary) / "rows.parquet", Path(temporary) / "dataset"
        table = example_table(STROKES)
        pq.write_table(table, rows)
        export_lerobot(rows, folder, FPS)
        done = subprocess.run([args.lerobot, "-c", READER, folder], capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"LeRobot did not open it:\n{done.stderr}", file=sys.stderr)
        return 1
    faults = differences(json.loads(done.stdout.splitlines()[-1]), table["path"].to_pylist())
    print("\n".join(faults) or f"LeRobot reads {STROKES} episodes as they were exported.")
    return 1 if faults else 0


def differences(seen: dict[str, Any], paths: list[list[list[float]]]) -> list[str]:
    """What LeRobot reads otherwise than it was written: a sentence each."""
    faults = []
    if seen["episodes"] != len(paths):
        faults.append(f"{seen['episodes']} episodes were read, and {len(paths)} written.")
    actions, episode = np.array(seen["actions"]), np.array(seen["episode"])
    for number, path in enumerate(paths):
        own, commanded = actions[episode == number], np.array(path)[:, 1:]
        if not len(own) or not np.allclose(own[[0, -1]], commanded[[0, -1]], atol=1e-5):
            faults.append(f"Episode {number} does not begin and end as its path does.")
    if sorted(seen["picture"])[0] != 3:
        faults.append(f"A picture has the shape {seen['picture']}.")
    return faults


if __name__ == "__main__":
    sys.exit(main())
