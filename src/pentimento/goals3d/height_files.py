"""Reliefs from height map files: 16-bit PNG (0 = hole) and NumPy arrays."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError, ImageError
from pentimento.contracts.height_maps import decode_height_m
from pentimento.planning.pushes.goal import GoalError
from pentimento.planning.pushes.holes import fill_holes

FloatArray = NDArray[np.float64]

_MAX_HOLES = 0.5


def height_file_relief(path: Path) -> tuple[FloatArray, int]:
    """The heights [h, w] of a ``.png`` or ``.npy`` file, and how many holes were filled from around them.

    Raises:
        GoalError: unreadable, no map of real numbers, more than half of it holes, or infinite heights.
    """
    try:
        if path.suffix.lower() == ".npy":
            heights = np.load(path, allow_pickle=False)
        else:
            heights = decode_height_m(path.read_bytes(), 1.0)
    except (OSError, ValueError, EOFError, SyntaxError, TokenError, MemoryError, ImageError, ContractError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise GoalError(f"{path} cannot be read as a height map ({reason}); save it as 16-bit PNG or .npy.") from error
    if heights.ndim != 2 or heights.dtype.kind not in "fiu" or min(heights.shape) < 2:
        raise GoalError(f"{path} holds {heights.dtype}{list(heights.shape)}; a height map is real numbers [h, w].")
    heights = heights.astype(np.float64)
    holes = int(np.isnan(heights).sum())
    if holes > _MAX_HOLES * heights.size:
        raise GoalError(
            f"{path}: {holes} of {heights.size} pixels are holes; a goal needs at least half of them measured."
        )
    try:
        return fill_holes(heights)
    except ContractError as error:
        raise GoalError(f"{path}: {error}") from None
