"""The clock runs over the second painting alone, and bytes come in the order of the shards."""

import time
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("distributed", reason="dask is not installed")
from studies import cluster


def test_what_is_slow_once_is_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: set[int] = set()

    def paint(job: int) -> bytes:
        time.sleep(0.0 if job in seen else 0.2)
        seen.add(job)
        return bytes([job])

    monkeypatch.setattr(cluster, "paint_shard", paint)
    with ThreadPoolExecutor(2) as executor:
        seconds, made = cluster.painted([3, 1, 2], executor)  # type: ignore[list-item]
    assert made == [b"\x03", b"\x01", b"\x02"]
    assert 0 < seconds < 0.2
