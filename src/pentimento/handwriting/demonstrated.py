"""Rows of the ``demonstrations`` contract as tensors, and their split by session."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.handwriting.recording import standardise
from pentimento.handwriting.trajvae import Strokes


@dataclass(frozen=True, eq=False)
class Demonstrated:
    """B strokes of several writers and sessions."""

    strokes: Strokes
    hand: tuple[str, ...]
    session: tuple[str, ...]

    def pick(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> Demonstrated:
        """The strokes at these indices."""
        chosen = np.arange(len(self.hand))[index]
        hand, session = (tuple(names[i] for i in chosen) for names in (self.hand, self.session))
        return Demonstrated(self.strokes.pick(torch.from_numpy(chosen)), hand, session)

    def of(self, hand: str) -> Demonstrated:
        """The strokes of one writer."""
        return self.pick(np.array([name == hand for name in self.hand]))

    @property
    def hands(self) -> tuple[str, ...]:
        """Writers in the order of their first stroke."""
        return tuple(dict.fromkeys(self.hand))


def demonstrated(table: pa.Table, points: int) -> Demonstrated:
    """The table's strokes at ``points`` points each.

    Raises:
        ContractError: the table is empty, or a row has fewer than two distinct places; the message names it.
    """
    if table.num_rows == 0:
        raise ContractError("The demonstrations table has no rows; gather demonstrations first.")
    standard = []
    for number, row in enumerate(table.column("points").to_pylist()):
        try:
            standard.append(standardise(np.array(row, dtype=np.float64), points)[0])
        except ContractError as error:
            raise ContractError(f"Row {number} of the demonstrations: {error}") from error
    stacked = np.stack(standard)
    height = stacked[..., 3]
    known = np.asarray(np.isfinite(height).all(axis=1), dtype=np.bool_)
    strokes = Strokes(
        torch.from_numpy(stacked[..., 1:3].astype(np.float32)),
        torch.from_numpy(np.where(known[:, None], height, 0.0).astype(np.float32)),
        torch.from_numpy(known.astype(np.float32)),
    )
    return Demonstrated(strokes, tuple(table.column("hand").to_pylist()), tuple(table.column("session").to_pylist()))


def split_last_session(all_strokes: Demonstrated) -> tuple[Demonstrated, Demonstrated]:
    """Training split, and test split: each writer's last session in order of name.

    Raises:
        ContractError: a writer has one session only.
    """
    held_out = np.zeros(len(all_strokes.hand), dtype=bool)
    sessions = np.array(all_strokes.session)
    for hand in all_strokes.hands:
        own: NDArray[np.bool_] = np.array([name == hand for name in all_strokes.hand])
        names = sorted(set(sessions[own]))
        if len(names) < 2:
            raise ContractError(
                f"The writer {hand} has one session, {names[0]}; record another, so that one can be held out."
            )
        held_out |= own & (sessions == names[-1])
    return all_strokes.pick(~held_out), all_strokes.pick(held_out)
