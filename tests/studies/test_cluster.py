"""Bytes come in the order of the shards, and the clock runs until the last of them is painted."""

import time
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("distributed", reason="dask is not installed")
from studies import cluster


def test_all_shards_are_timed_and_come_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    def paint(job: int) -> bytes:
        time.sleep(0.1 if job == 3 else 0.0)
        return bytes([job])

    monkeypatch.setattr(cluster, "paint_shard", paint)
    with ThreadPoolExecutor(2) as executor:
        seconds, made = cluster.painted([3, 1, 2], executor)  # type: ignore[list-item]
    assert made == [b"\x03", b"\x01", b"\x02"]
    assert seconds >= 0.1
