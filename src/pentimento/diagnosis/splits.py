"""Which strokes find causes, which confirm them, and which are sealed until the end (GAP.md, rule 4)."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError

Array = NDArray[Any]

_FEWEST_ACTIONS = 12
_FEWEST_REPEATED = 6
_TEST, _CONFIRMATION = 0.2, 0.2


class Actions(Protocol):
    """Rows of a table, as far as their splitting goes."""

    @property
    def action(self) -> Array:
        """int64[B]: rows of one value repeat one command."""

    @property
    def block(self) -> Array:
        """int64[B]: what should stay together."""


class Splits(NamedTuple):
    """Row indices; all rows of one action are in one part."""

    discovery: Array
    confirmation: Array
    test: Array


def split(measured: Actions, seed: int) -> Splits:
    """60 % of the actions find, 20 % confirm, 20 % are sealed.

    Repeated actions are sealed first: the noise floor is read off them. Blocks (strokes between two dips, pushes
    between two smoothings) stay together, as far as their actions allow.

    Raises:
        ContractError: too few actions for three parts.
    """
    actions, first, count = np.unique(measured.action, return_index=True, return_counts=True)
    if len(actions) < _FEWEST_ACTIONS:
        raise ContractError(
            f"The table has {len(actions)} different actions; to find, confirm and test a cause on different strokes "
            f"takes at least {_FEWEST_ACTIONS}, and to find anything but a large effect about 60."
        )
    rng = np.random.default_rng([seed, 7])
    repeated = actions[count > 1] if (count > 1).sum() >= _FEWEST_REPEATED else actions[:0]
    wanted = max(round(_TEST * len(actions)), 3)
    test = rng.permutation(repeated)[:wanted]
    left = np.setdiff1d(actions, test)
    block = measured.block[first[np.searchsorted(actions, left)]]
    order = rng.permutation(np.unique(block))
    by_block = [left[block == b] for b in order]
    taken = np.concatenate(by_block)
    if len(test) < wanted:
        test, taken = np.concatenate([test, taken[: wanted - len(test)]]), taken[wanted - len(test) :]
    confirming = max(round(_CONFIRMATION * len(actions)), 3)
    parts = taken[confirming:], taken[:confirming], test
    return Splits(*(np.flatnonzero(np.isin(measured.action, part)) for part in parts))
