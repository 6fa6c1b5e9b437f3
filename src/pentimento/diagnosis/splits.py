"""Three splits of the actions: discovery chooses causes, confirmation helps to decide about them, test reports."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.problem import Rows

Array = NDArray[Any]

_SHARES = (0.6, 0.2)
"""Of discovery and confirmation; the test split has the rest."""
_REPEATED = (0.25, 0.25)
"""The same of repeated actions. Half of them go to the test split, whose noise floor is reported."""
FEWEST_ACTIONS = 15
"""Three in each of the smaller splits."""
_ENOUGH_ACTIONS = 60
"""From here on not only large effects are found."""


class Splits(NamedTuple):
    """Indices of rows; all rows of one action are in one split."""

    discovery: Array
    confirmation: Array
    test: Array


def split(rows: Rows, seed: int) -> Splits:
    """Split the rows by action. Each split gets repeated actions, so that it has a noise floor.

    Single actions of one block stay together as far as the shares allow.

    Raises:
        ContractError: too few actions.
    """
    actions, first, count = np.unique(rows.action, return_index=True, return_counts=True)
    if len(actions) < FEWEST_ACTIONS:
        raise ContractError(
            f"The table has {len(actions)} different actions. To find, confirm and test a cause on different actions "
            f"takes at least {FEWEST_ACTIONS}, and about {_ENOUGH_ACTIONS} to find anything but a large effect."
        )
    rng = np.random.default_rng([seed, 7])
    block = rows.block[first]
    order = {b: place for place, b in enumerate(rng.permutation(np.unique(block)))}
    single = sorted(np.flatnonzero(count == 1), key=lambda i: order[block[i]])
    repeated = rng.permutation(np.flatnonzero(count > 1))
    part = np.empty(len(actions), dtype=int)
    for group, shares in ((np.array(single, dtype=int), _SHARES), (repeated, _REPEATED)):
        ends = np.round(np.cumsum(shares) * len(group)).astype(int)
        part[group] = np.searchsorted(ends, np.arange(len(group)), side="right")
    of_row = part[np.searchsorted(actions, rows.action)]
    return Splits(*(np.flatnonzero(of_row == k) for k in range(3)))


def few_actions(rows: Rows) -> str | None:
    """A warning about few different actions; None where there are enough."""
    actions = len(rows.first_of_action)
    if actions >= _ENOUGH_ACTIONS:
        return None
    return (
        f"There are {actions} different actions; with fewer than about {_ENOUGH_ACTIONS}, only large effects are "
        "found. Make more."
    )
