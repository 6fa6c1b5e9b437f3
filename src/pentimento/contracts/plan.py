"""A plan: the strokes that a robot will paint, as readable JSON lines.

The first line is the header, then one line a stroke. The header has the number of strokes, so that a truncated file is
rejected.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ContractError

SCHEMA: Final = 1
_UNITS: Final = "path: t_s, x_m, y_m, z_m, yaw_rad in the canvas frame; colours: sRGB in [0, 1]"


@dataclass(frozen=True, eq=False)
class PlannedStroke:
    """One stroke to execute."""

    path: npt.NDArray[np.float64]
    """[N, 5] commanded tip in the canvas frame: t_s from the stroke's start, x_m, y_m, z_m, yaw_rad."""
    color_srgb: npt.NDArray[np.float64]
    """[3] sRGB in [0, 1]."""
    dip: bool
    """Load the tool with this colour first."""


@dataclass(frozen=True, eq=False)
class PlanHeader:
    """What all strokes of a plan share."""

    tool: str
    palette_srgb: npt.NDArray[np.float64]
    """[K, 3] sRGB in [0, 1]."""
    canvas_size_m: tuple[float, float]
    """Width, height."""
    envelope: str
    """Id of the safety envelope that the plan was checked against."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Strokes in the order of execution."""

    header: PlanHeader
    strokes: tuple[PlannedStroke, ...]


def write_plan(path: Path, plan: Plan) -> None:
    """Write a plan, atomically.

    Raises:
        ContractError: NaN or infinity, a wrong shape, a colour outside [0, 1].
    """
    header = plan.header
    lines = [
        {
            "schema": SCHEMA,
            "kind": "plan",
            "units": _UNITS,
            "tool": header.tool,
            "palette_srgb": _colours(header.palette_srgb, (-1, 3), "The palette").tolist(),
            "canvas_size_m": list(_size(header.canvas_size_m)),
            "envelope": header.envelope,
            "strokes": len(plan.strokes),
        }
    ]
    for index, stroke in enumerate(plan.strokes):
        where = f"Stroke {index} of the plan"
        path_list = _numbers(stroke.path, (-1, 5), f"{where}, path").tolist()
        colour = _colours(stroke.color_srgb, (3,), f"{where}, colour").tolist()
        lines.append({"path": path_list, "color_srgb": colour, "dip": bool(stroke.dip)})
    text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
    atomic_write(Path(path), text.encode())


def read_plan(path: Path) -> Plan:
    """Read a plan that `write_plan` wrote.

    Raises:
        ContractError: missing, cut off, of another schema, or with NaN or wrong shapes.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ContractError(f"Plan {path} cannot be read: {error}.") from error
    if not lines:
        raise ContractError(f"Plan {path} is empty; write it again.")
    first = _parsed(lines[0], f"{path}, line 1")
    if first.get("kind") != "plan" or first.get("schema") != SCHEMA:
        raise ContractError(f"{path} is not a plan of schema {SCHEMA}; its first line must be a plan's header.")
    header = PlanHeader(
        tool=str(_entry(first, "tool", f"{path}, line 1")),
        palette_srgb=_colours(_entry(first, "palette_srgb", f"{path}, line 1"), (-1, 3), f"{path}, palette"),
        canvas_size_m=_size(_entry(first, "canvas_size_m", f"{path}, line 1")),
        envelope=str(_entry(first, "envelope", f"{path}, line 1")),
    )
    if _entry(first, "strokes", f"{path}, line 1") != len(lines) - 1:
        raise ContractError(
            f"Plan {path} promises {first['strokes']} strokes and holds {len(lines) - 1}; it was cut off."
        )
    strokes = tuple(_stroke(line, f"{path}, line {n}") for n, line in enumerate(lines[1:], start=2))
    return Plan(header, strokes)


def _stroke(line: str, where: str) -> PlannedStroke:
    entry = _parsed(line, where)
    dip = _entry(entry, "dip", where)
    if not isinstance(dip, bool):
        raise ContractError(f"{where}: dip is {dip!r}; it must be true or false.")
    return PlannedStroke(
        path=_numbers(_entry(entry, "path", where), (-1, 5), f"{where}, path"),
        color_srgb=_colours(_entry(entry, "color_srgb", where), (3,), f"{where}, colour"),
        dip=dip,
    )


def _parsed(line: str, where: str) -> Mapping[str, Any]:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError) as error:  # brackets in brackets, numbers of thousands of digits
        raise ContractError(f"{where} is not JSON ({error}); the file is damaged.") from error
    if not isinstance(entry, dict):
        raise ContractError(f"{where} is not a JSON object.")
    return entry


def _entry(entry: Mapping[str, Any], key: str, where: str) -> Any:
    if key not in entry:
        raise ContractError(f"{where} lacks {key!r}.")
    return entry[key]


def _numbers(values: Any, shape: tuple[int, ...], what: str) -> npt.NDArray[np.float64]:
    """Finite float64 of `shape`, where -1 stands for any length of at least 1."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ContractError(f"{what} is not an array of numbers.") from error
    fits = array.ndim == len(shape) and all(
        size >= 1 if want == -1 else size == want for size, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise ContractError(f"{what} has shape {array.shape}; {str(shape).replace('-1', 'N')} is needed.")
    if not np.isfinite(array).all():
        raise ContractError(f"{what} has a NaN or infinite number; a robot cannot follow it.")
    return array


def _colours(values: Any, shape: tuple[int, ...], what: str) -> npt.NDArray[np.float64]:
    array = _numbers(values, shape, what)
    if array.min() < 0.0 or array.max() > 1.0:
        raise ContractError(f"{what} lies outside [0, 1]; divide 8-bit sRGB by 255.")
    return array


def _size(values: Any) -> tuple[float, float]:
    size = _numbers(values, (2,), "The plan's canvas size")
    if not all(math.isfinite(v) and v > 0 for v in size):
        raise ContractError(f"The plan's canvas size {size.tolist()} m must be positive.")
    return float(size[0]), float(size[1])
