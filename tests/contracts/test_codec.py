"""Dataclasses survive the way through JSON, and anything else is refused with its place."""

import json
from dataclasses import replace
from typing import Any

import pytest

from pentimento.contracts.codec import from_plain, to_plain
from pentimento.contracts.errors import ContractError
from pentimento.planning.strokes.brush import Span
from pentimento.planning.strokes.config import PlannerConfig, StyleConfig
from tests.bundle.tiny_bundle import PLANNER

STYLED = replace(PLANNER, objectives=replace(PLANNER.objectives, style=StyleConfig(0.05, "a.png", "local", None)))


@pytest.mark.parametrize("config", [PLANNER, STYLED])
def test_a_planner_comes_back_from_json(config: PlannerConfig) -> None:
    assert from_plain(PlannerConfig, json.loads(json.dumps(to_plain(config))), "planner") == config


def test_whole_numbers_are_accepted_as_floats() -> None:
    assert to_plain(Span(1.0, 2.0, 3.0)) == {"low": 1.0, "mean": 2.0, "high": 3.0}
    assert from_plain(Span, {"low": 1, "mean": 2, "high": 3}, "span") == Span(1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rounds": 1.5}, r"planner\.rounds is 1\.5; it must be a whole number"),
        ({"rounds": True}, r"planner\.rounds is True"),
        ({"pixels_per_m": float("nan")}, "pixels_per_m is nan; it must be above 0"),
        ({"pixels_per_m": "800"}, "it must be a finite number"),
        ({"initialisation": "guess"}, "one of"),
        ({"sizes": [0.5]}, "a list of 2"),
        ({"sizes": [0.5, 3.0]}, "sizes is"),  # the planner's own check
        ({"execution_noise": None}, r"planner\.execution_noise is None; it must be a mapping"),
        ({"more": 1}, r"unknown keys \['more'\]"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ContractError, match=message):
        from_plain(PlannerConfig, to_plain(PLANNER) | changed, "planner")


def test_a_missing_key_is_named() -> None:
    plain = to_plain(PLANNER)
    del plain["seed"]
    with pytest.raises(ContractError, match=r"missing keys \['seed'\]"):
        from_plain(PlannerConfig, plain, "planner")
