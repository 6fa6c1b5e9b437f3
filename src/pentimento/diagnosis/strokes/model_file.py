"""The extended model as a file: the base's numbers, the paints' offsets, and the mechanisms with what they refer to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.strokes.ends import UnevenEnds
from pentimento.diagnosis.strokes.predict import BASE, Model
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.simulation import Mechanism

Array = NDArray[Any]

SCHEMA = 2


def model_as_json(model: Model, paints: Array) -> dict[str, Any]:
    """What ``extended_model.json`` holds; ``paints`` [K, 3] sRGB are those of the model's colour offsets."""
    return {
        "schema": SCHEMA,
        "kind": "strokes",
        "press_m": [float(depth) for depth in model.press_m],
        "base": {name: float(value) for name, value in zip(BASE, model.base, strict=True)},
        "paints": [
            {"color_srgb": [float(v) for v in paint], "offset_linear": [float(v) for v in offset]}
            for paint, offset in zip(paints, model.color_offset, strict=True)
        ],
        "mechanisms": [
            {
                "cause": mechanism.cause,
                "site": mechanism.site,
                "values": {
                    quantity.name: {"value": float(value), "unit": quantity.unit}
                    for quantity, value in zip(mechanism.quantities, mechanism.values, strict=True)
                },
                "reference": {name: float(value) for name, value in mechanism.reference.items()},
            }
            for mechanism in model.mechanisms
        ],
    }


def read_model(path: Path) -> tuple[Model, Array]:
    """Read ``extended_model.json``: the model, and the paints [K, 3] sRGB of its colour offsets.

    Raises:
        ContractError: missing, not JSON, of another schema, or with causes or numbers that this version does not know.
    """
    try:
        stored = json.loads(Path(path).read_text(encoding="utf-8"))
        if stored["schema"] != SCHEMA or stored["kind"] != "strokes":
            raise ValueError(f"schema {stored['schema']} of {stored['kind']}, not {SCHEMA} of strokes")
        if sorted(stored["base"]) != sorted(BASE):
            raise ValueError(f"its base has the numbers {', '.join(stored['base'])}, not {', '.join(BASE)}")
        base = np.array([float(stored["base"][name]) for name in BASE])
        paints = np.array([paint["color_srgb"] for paint in stored["paints"]], dtype=float).reshape(-1, 3)
        offsets = np.array([paint["offset_linear"] for paint in stored["paints"]], dtype=float).reshape(-1, 3)
        low, high = map(float, stored["press_m"])
        mechanisms = tuple(_mechanism(entry) for entry in stored["mechanisms"])
        return Model((low, high), base, offsets, mechanisms), paints
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ContractError(
            f"{path} is not an extended model ({error}): write one with `pentimento diagnose`."
        ) from error


def _mechanism(entry: dict[str, Any]) -> Mechanism:
    known: tuple[type[Mechanism], ...] = (*VOCABULARY, UnevenEnds)
    kinds = {kind.cause: kind for kind in known}
    if entry["cause"] not in kinds:
        raise ValueError(f"cause {entry['cause']} is not in the vocabulary")
    kind = kinds[entry["cause"]]
    values = [float(entry["values"][quantity.name]["value"]) for quantity in kind.quantities]
    return kind(torch.tensor(values, dtype=torch.float64), {n: float(v) for n, v in entry["reference"].items()})
