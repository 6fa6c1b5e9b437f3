import time
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("distributed", reason="dask is not installed")
from studies import cluster


def test_shards_come_in_order_and_the_last_one_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    def paint(job: int) -> bytes:
        time.sleep(0.1 if job == 3 else 0.0)
        return bytes([job])

    monkeypatch.setattr(cluster, "paint_shard", paint)
    with ThreadPoolExecutor(2) as executor:
        seconds, output = cluster.painted([3, 1, 2], executor)  # type: ignore[list-item]
    assert output == [b"\x03", b"\x01", b"\x02"]
    assert seconds >= 0.1
