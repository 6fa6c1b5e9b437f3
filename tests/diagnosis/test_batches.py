"""Processing rows in batches."""

from __future__ import annotations

import numpy as np
import pytest

from pentimento.diagnosis.batches import in_batches


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("count", [1, 4, 8, 9])
def test_batches_cover_each_row_once_and_in_order(count: int, threads: int) -> None:
    seen = in_batches(lambda some: np.arange(count)[some], count, 4, threads)
    assert max(map(len, seen)) <= 4
    assert np.concatenate(seen).tolist() == list(range(count))
