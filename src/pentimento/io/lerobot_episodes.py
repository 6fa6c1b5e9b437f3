"""The episodes of a LeRobot dataset, file by file: their frames' numbers, and their first and last pictures.

What cannot be used is left out of what is yielded, and noted with its reason in ``refused``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.io.lerobot_folder import Dataset, read_numbers, rows_by_episode
from pentimento.io.lerobot_pictures import Pair, embedded_pairs, video_pairs
from pentimento.io.stroke_rows import Refused

_FEWEST_FRAMES: Final = 2

Reasons = dict[str, list[str]]
"""Numbers of episodes by the reason for which they were left out."""


class Episode(NamedTuple):
    """One whose frames are all there."""

    place: int
    """Among the dataset's episodes."""
    number: int
    """Its ``episode_index``."""
    rows: NDArray[np.intp]
    """Of its data file."""


def leave_out(refused: Reasons, reason: object, numbers: Iterable[int]) -> None:
    """Note why episodes are left out."""
    refused.setdefault(str(reason), []).extend(str(number) for number in numbers)


def sound_episodes(
    dataset: Dataset, names: list[str], refused: Reasons
) -> Iterator[tuple[Path, dict[str, NDArray[np.float64]], list[Episode]]]:
    """For each data file: its columns ``names``, beside those that number frames, and its episodes in their order.

    Raises:
        ContractError: the dataset does not say where its episodes are.
    """
    index, length = (dataset.whole_numbers(name) for name in ("episode_index", "length"))
    by_file: dict[tuple[int, int], list[int]] = {}
    numbers = zip(*(dataset.whole_numbers(f"data/{of}_index") for of in ("chunk", "file")), strict=True)
    for place, file_number in enumerate(numbers):
        by_file.setdefault(file_number, []).append(place)
    for file_number, places in by_file.items():
        try:
            file = dataset.data_file(*file_number)
            columns = read_numbers(file, ["episode_index", "frame_index", *names])
        except Refused as reason:
            leave_out(refused, reason, (index[place] for place in places))
            continue
        rows = rows_by_episode(columns["episode_index"])
        episodes = [Episode(place, index[place], rows.get(index[place], np.zeros(0, np.intp))) for place in places]
        faults = [_fault(episode, columns["frame_index"], length[episode.place]) for episode in episodes]
        for episode, fault in zip(episodes, faults, strict=True):
            if fault is not None:
                leave_out(refused, fault, [episode.number])
        sound = [episode for episode, fault in zip(episodes, faults, strict=True) if fault is None]
        yield file, columns, sorted(sound, key=lambda episode: int(episode.rows[0]))


def _fault(episode: Episode, frame_index: NDArray[np.float64], length: int) -> str | None:
    if len(episode.rows) != length:
        return "it has another number of frames than meta/episodes says"
    if length < _FEWEST_FRAMES:
        return f"it has fewer than {_FEWEST_FRAMES} frames"
    numbered = np.array_equal(frame_index[episode.rows], np.arange(length))
    return None if numbered else "its frames are not numbered one after the other"


def first_and_last_pictures(
    dataset: Dataset, camera: str, file: Path, episodes: list[Episode], refused: Reasons
) -> Iterator[tuple[Episode, Pair]]:
    """Of each episode of a data file that has them: its first and its last picture [H, W, 3], sRGB.

    Raises:
        ContractError: the dataset does not say where its videos are.
    """
    shape = dataset.features[camera]["shape"]
    if dataset.features[camera]["dtype"] == "image":
        rows = [(int(episode.rows[0]), int(episode.rows[-1])) for episode in episodes]
        yield from _noted(embedded_pairs(file, camera, shape, rows), episodes, refused)
        return
    start_s = dataset.times_s(f"videos/{camera}/from_timestamp")
    numbers = list(
        zip(*(dataset.whole_numbers(f"videos/{camera}/{of}_index") for of in ("chunk", "file")), strict=True)
    )
    for video_number in dict.fromkeys(numbers[episode.place] for episode in episodes):
        part = [episode for episode in episodes if numbers[episode.place] == video_number]
        part.sort(key=lambda episode: start_s[episode.place])
        try:
            video = dataset.video_file(camera, *video_number)
        except Refused as reason:
            leave_out(refused, reason, (episode.number for episode in part))
            continue
        starts = [start_s[episode.place] for episode in part]
        times_s = [(at, at + (len(e.rows) - 1) / dataset.fps) for at, e in zip(starts, part, strict=True)]
        yield from _noted(video_pairs(video, shape, dataset.fps, times_s), part, refused)


def _noted(
    pairs: Iterator[Pair | Refused], episodes: list[Episode], refused: Reasons
) -> Iterator[tuple[Episode, Pair]]:
    done = 0
    try:
        for pair in pairs:
            episode = episodes[done]
            done += 1
            if isinstance(pair, Refused):
                leave_out(refused, pair, [episode.number])
            else:
                yield episode, pair
    except Refused as reason:
        leave_out(refused, reason, (episode.number for episode in episodes[done:]))
