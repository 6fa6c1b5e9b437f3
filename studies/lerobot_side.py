"""What `studies/lerobot_reads.py` runs in an environment with `lerobot`, which has none of Pentimento's packages.

Frames are an `.npz` file with ``action`` [N, 4], ``episode`` [N] and ``picture`` [N, H, W, 3], sRGB, 8 bits.
"""

import argparse
import importlib.metadata
import sys
from pathlib import Path

import numpy as np
from lerobot.datasets.dataset_tools import delete_episodes, merge_datasets
from lerobot.datasets.lerobot_dataset import LeRobotDataset

NAME = "local/strokes"
CANVAS = "observation.images.canvas"
AXES = ["x", "y", "z", "yaw"]


def main() -> None:
    """Command line: `read`, `record`, `delete` or `merge`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["version", "read", "record-image", "record-video", "delete", "merge"])
    parser.add_argument("files", nargs="*", type=Path)
    args = parser.parse_args()
    if args.what == "version":
        print(importlib.metadata.version("lerobot"))
    elif args.what == "read":
        read(*args.files)
    elif args.what.startswith("record"):
        record(*args.files, kind=args.what.removeprefix("record-"))
    elif args.what == "delete":
        root, out = args.files
        delete_episodes(LeRobotDataset(NAME, root=root), [0], output_dir=out, repo_id=NAME)
    else:
        *roots, out = args.files
        merge_datasets([LeRobotDataset(NAME, root=root) for root in roots], NAME, output_dir=out)


def read(root: Path, out: Path) -> None:
    """The frames of a dataset, as LeRobot gives them to a network; also an episode alone, with actions ahead."""
    dataset = LeRobotDataset(NAME, root=root)
    frames = [dataset[number] for number in range(len(dataset))]
    pictures = [frame[CANVAS].permute(1, 2, 0).numpy() for frame in frames]
    action = np.stack([frame["action"].numpy() for frame in frames])
    episode = np.array([int(frame["episode_index"]) for frame in frames])
    ahead = LeRobotDataset(NAME, root=root, episodes=[1], delta_timestamps={"action": [0.0, 1 / dataset.fps]})[0]
    assert np.array_equal(ahead["action"].numpy(), action[episode == 1][:2]), "Chunks of actions are others."
    for key in ("action", "observation.state", CANVAS):
        shape = (3, 1, 1) if key == CANVAS else (len(AXES),)
        assert all(np.shape(dataset.meta.stats[key][of]) == shape for of in ("min", "max", "mean", "std")), key
    shown = np.round(255 * np.stack(pictures)).astype(np.uint8)
    np.savez(out, action=action, episode=episode, picture=shown, task=[frame["task"] for frame in frames])


def record(frames: Path, root: Path, kind: str, fps: int = 30) -> None:
    """A new dataset, as LeRobot's recording makes it; videos by its default codec, which is AV1."""
    with np.load(frames) as held:
        action, episode, picture = held["action"], held["episode"], held["picture"]
    shown = {"dtype": kind, "shape": picture.shape[1:], "names": ["height", "width", "channels"]}
    moved = {"dtype": "float32", "shape": (len(AXES),), "names": AXES}
    features = {"action": moved, "observation.state": moved, CANVAS: shown}
    dataset = LeRobotDataset.create(NAME, fps, features, root=root, use_videos=kind == "video")
    for number in np.unique(episode):
        for at in np.flatnonzero(episode == number):
            values = action[at].astype(np.float32)
            frame = {"action": values, "observation.state": values, CANVAS: picture[at], "task": "Paint."}
            dataset.add_frame(frame)
        dataset.save_episode()
    dataset.finalize()


if __name__ == "__main__":
    sys.exit(main())
