"""Discovery, confirmation and test split."""

from typing import NamedTuple

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.evaluation import split
from pentimento.diagnosis.strokes.measured import Measured, load_measured


@pytest.fixture(scope="module")
def measured() -> Measured:
    return load_measured(example_table(80))


def test_splits_partition_rows_and_keep_actions_together(measured: Measured) -> None:
    parts = split(measured, 0)
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(len(measured)))
    actions = [set(measured.action[rows]) for rows in parts]
    assert not (actions[0] & actions[1] or actions[0] & actions[2] or actions[1] & actions[2])


class Rows(NamedTuple):
    """All that a split looks at."""

    action: np.ndarray
    block: np.ndarray


@pytest.mark.parametrize("pairs", [0, 5, 8, 30])
def test_test_split_takes_repeated_actions_first(pairs: int) -> None:
    row = np.arange(80)
    rows = Rows(np.where(row < 2 * pairs, row // 2, row), row // 10)
    actions = [np.unique(rows.action[part]) for part in split(rows, 0)]
    fifth = round(0.2 * len(np.unique(rows.action)))
    assert [len(part) for part in actions[1:]] == [fifth, fifth]
    if pairs >= 6:  # fewer tell no floor
        assert (actions[2] < pairs).sum() == min(pairs, fifth)


def test_split_depends_on_the_seed(measured: Measured) -> None:
    once, again, other = split(measured, 0), split(measured, 0), split(measured, 1)
    assert all((a == b).all() for a, b in zip(once, again, strict=True))
    assert any(len(a) != len(b) or (a != b).any() for a, b in zip(once, other, strict=True))


def test_rejects_too_few_actions_with_the_required_number(measured: Measured) -> None:
    with pytest.raises(ContractError, match="at least 12"):
        split(measured.pick(np.arange(8)), 0)
