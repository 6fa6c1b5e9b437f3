"""Discovery and test split of pushes."""

from typing import NamedTuple

import numpy as np
import pytest

from pentimento.diagnosis.pushes.measured import split_pushes

SINGLE, REPEATED, TIMES, PER_BLOCK = 60, 20, 3, 4


class Rows(NamedTuple):
    """Rows as a split needs them."""

    action: np.ndarray
    block: np.ndarray


def rows_of(repeated: int) -> Rows:
    """Single actions, some between two smoothings, then repeated ones, each push on smoothed material."""
    action = np.concatenate([np.arange(SINGLE), np.repeat(np.arange(SINGLE, SINGLE + repeated), TIMES)])
    later = np.arange(SINGLE, len(action))
    return Rows(action, np.concatenate([np.arange(SINGLE) // PER_BLOCK, later]))


@pytest.mark.parametrize("repeated", [0, 3, REPEATED])
@pytest.mark.parametrize("seed", [0, 1])
def test_splits_partition_rows_by_action(repeated: int, seed: int) -> None:
    rows = rows_of(repeated)
    discovery, test = split_pushes(rows, seed)
    np.testing.assert_array_equal(np.sort(np.concatenate([discovery, test])), np.arange(len(rows.action)))
    assert not set(rows.action[discovery]) & set(rows.action[test])
    assert len(np.unique(rows.action[test])) == pytest.approx(0.2 * (SINGLE + repeated), abs=PER_BLOCK)


def test_test_split_is_half_repeats_half_whole_blocks() -> None:
    rows = rows_of(REPEATED)
    test = split_pushes(rows, 0).test
    repeated = np.unique(rows.action[test][rows.action[test] >= SINGLE])
    assert len(repeated) == round(0.2 * (SINGLE + REPEATED)) // 2
    singles = test[rows.action[test] < SINGLE]
    assert len(singles) >= len(repeated)
    for block in np.unique(rows.block[singles]):
        assert (rows.block[singles] == block).sum() == PER_BLOCK
