"""The analytic model as a file: the base's numbers, and the mechanisms with what they refer to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.pushes.analytic import BASE, AnalyticPush
from pentimento.dynamics.pushes.mechanisms import VOCABULARY, Mechanism

SCHEMA = 1


def model_as_json(model: AnalyticPush, half_width_m: float) -> dict[str, Any]:
    """What ``extended_model.json`` holds; ``half_width_m`` is that of the scene which the model was fitted to."""
    return {
        "schema": SCHEMA,
        "kind": "pushes",
        "half_width_m": half_width_m,
        "ball_radius_m": model.ball_radius_m,
        "base": {name: float(value) for name, value in zip(BASE, model.base, strict=True)},
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


def read_model(path: Path) -> tuple[AnalyticPush, float]:
    """Read ``extended_model.json``: the model, and the half-width of the footprint that its lengths count in.

    Raises:
        ContractError: missing, not JSON, of another schema, or with causes or numbers that this version does not know.
    """
    try:
        return model_from_json(json.loads(Path(path).read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ContractError(
            f"{path} is not an extended model of pushes ({error}): write one with `pentimento diagnose`."
        ) from error


def model_from_json(stored: dict[str, Any]) -> tuple[AnalyticPush, float]:
    """What ``model_as_json`` was given.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: it is something else.
    """
    if stored["schema"] != SCHEMA or stored["kind"] != "pushes":
        raise ValueError(f"schema {stored['schema']} of {stored['kind']}, not {SCHEMA} of pushes")
    if sorted(stored["base"]) != sorted(BASE):
        raise ValueError(f"its base has the numbers {', '.join(stored['base'])}, not {', '.join(BASE)}")
    base = np.array([float(stored["base"][name]) for name in BASE])
    mechanisms = tuple(_mechanism(entry) for entry in stored["mechanisms"])
    return AnalyticPush(float(stored["ball_radius_m"]), base, mechanisms), float(stored["half_width_m"])


def _mechanism(entry: dict[str, Any]) -> Mechanism:
    kinds = {kind.cause: kind for kind in VOCABULARY}
    if entry["cause"] not in kinds:
        raise ValueError(f"cause {entry['cause']} is not in the vocabulary")
    kind = kinds[entry["cause"]]
    values = [float(entry["values"][quantity.name]["value"]) for quantity in kind.quantities]
    return kind(np.array(values), {name: float(value) for name, value in entry["reference"].items()})
