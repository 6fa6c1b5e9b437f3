"""What of pushes is searched, and what is sealed."""

from typing import NamedTuple

import numpy as np
import pytest

from pentimento.diagnosis.pushes.splits import split_pushes

SINGLE, REPEATED, TIMES, PER_BLOCK = 60, 20, 3, 4


class Rows(NamedTuple):
    """All that a split looks at."""

    action: np.ndarray
    block: np.ndarray


def rows_of(repeated: int) -> Rows:
    """Single actions, some between two smoothings, then repeated ones, each push on smoothed material."""
    action = np.concatenate([np.arange(SINGLE), np.repeat(np.arange(SINGLE, SINGLE + repeated), TIMES)])
    later = np.arange(SINGLE, len(action))
    return Rows(action, np.concatenate([np.arange(SINGLE) // PER_BLOCK, later]))


@pytest.mark.parametrize("repeated", [0, 3, REPEATED])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_row_is_in_one_part_and_no_action_in_two(repeated: int, seed: int) -> None:
    rows = rows_of(repeated)
    discovery_split, test_split = split_pushes(rows, seed)
    np.testing.assert_array_equal(np.sort(np.concatenate([discovery_split, test_split])), np.arange(len(rows.action)))
    assert not set(rows.action[discovery_split]) & set(rows.action[test_split])
    assert len(np.unique(rows.action[test_split])) == pytest.approx(0.2 * (SINGLE + repeated), abs=PER_BLOCK)


def test_half_of_what_is_sealed_are_repeats_and_the_rest_whole_blocks() -> None:
    rows = rows_of(REPEATED)
    test_split = split_pushes(rows, 0).test_split
    repeated = np.unique(rows.action[test_split][rows.action[test_split] >= SINGLE])
    assert len(repeated) == round(0.2 * (SINGLE + REPEATED)) // 2
    singles = test_split[rows.action[test_split] < SINGLE]
    assert len(singles) >= len(repeated)
    for block in np.unique(rows.block[singles]):
        assert (rows.block[singles] == block).sum() == PER_BLOCK
