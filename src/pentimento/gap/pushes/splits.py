"""Which pushes find causes, which confirm them, and which are sealed until the end (GAP.md, rule 4)."""

from __future__ import annotations

import numpy as np

from pentimento.gap.pushes.measured import MeasuredPushes
from pentimento.gap.splits import Splits, split

_SEALED = 0.2


def split_pushes(measured: MeasuredPushes, seed: int) -> Splits:
    """60 % of the actions find, 20 % confirm, 20 % are sealed; half of what is sealed are repeated actions, where there
    are enough.

    The noise floor is read off repeats. They are made into fresh material, so that alone they would hide what depends
    on what was done before: the other half are whole blocks of other actions.

    Raises:
        ContractError: too few actions for three parts.
    """
    splits = split(measured, seed)
    actions, count = np.unique(measured.action, return_counts=True)
    repeated = actions[count > 1]
    sealed = np.unique(measured.action[splits.test])
    if not np.isin(sealed, repeated).all() or len(sealed) < 4:
        return splits  # blocks of all kinds are sealed as it is
    rng = np.random.default_rng([seed, 17])
    freed = rng.permutation(sealed)[len(sealed) // 2 :]
    single = np.setdiff1d(actions, repeated)
    first = {action: int(np.flatnonzero(measured.action == action)[0]) for action in single.tolist()}
    block = np.array([measured.block[first[action]] for action in single.tolist()])
    taken: list[int] = []
    for one in rng.permutation(np.unique(block)):
        if len(taken) >= len(freed):
            break
        taken += single[block == one].tolist()
    # The freed repeats take the places of what is sealed instead, in the same parts.
    parts = [set(np.unique(measured.action[rows]).tolist()) for rows in splits]
    places = [number for number, part in enumerate(parts[:2]) for action in taken if action in part]
    for action, number in zip(freed.tolist(), [*places, *[0] * len(freed)], strict=False):
        parts[number].add(action)
    for action in taken:
        parts[0].discard(action)
        parts[1].discard(action)
    parts[2] = (parts[2] - set(freed.tolist())) | set(taken)
    return Splits(*(np.flatnonzero(np.isin(measured.action, sorted(part))) for part in parts))
