"""Which pushes are searched for causes, and which are sealed until the end (docs/diagnosis.md §2, but for one thing).

The rule sets a fifth aside to confirm what is found, apart from what is sealed. Here the sealed ones confirm: pushes
differ from their repeats by their depth most of all, so that a tool's backlash or what hardens below needs many to be
seen, and a second fifth confirms less than a third more pushes find.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.diagnosis.evaluation import Actions, split

Array = NDArray[Any]


class Parts(NamedTuple):
    """Row indices; all rows of one action are in one part."""

    discovery_split: Array
    test_split: Array


def split_pushes(measured: Actions, seed: int) -> Parts:
    """80 % of the actions are searched, 20 % are sealed; half of what is sealed are repeated actions, where there are
    enough.

    The noise floor is read off repeats. They are made into fresh material, so that alone they would hide what depends
    on what was done before: the other half are whole blocks of other actions.

    Raises:
        ContractError: too few actions.
    """
    test_split = np.unique(measured.action[split(measured, seed).test])
    actions, count = np.unique(measured.action, return_counts=True)
    repeated = actions[count > 1]
    if np.isin(test_split, repeated).all() and len(test_split) >= 4:  # else blocks of all kinds are sealed as it is
        rng = np.random.default_rng([seed, 17])
        freed = rng.permutation(test_split)[len(test_split) // 2 :]
        single = np.setdiff1d(actions, repeated)
        first = {action: int(np.flatnonzero(measured.action == action)[0]) for action in single.tolist()}
        block = np.array([measured.block[first[action]] for action in single.tolist()])
        taken: list[int] = []
        for one in rng.permutation(np.unique(block)):
            if len(taken) >= len(freed):
                break
            taken += single[block == one].tolist()
        test_split = np.union1d(np.setdiff1d(test_split, freed), taken)
    in_test_split = np.isin(measured.action, test_split)
    return Parts(np.flatnonzero(~in_test_split), np.flatnonzero(in_test_split))
