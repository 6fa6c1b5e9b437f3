"""The numbers of docs/diagnosis.md are those of the code: weights, limits, and the worked example."""

import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from pentimento.diagnosis.decision import FEATURES, default_decision
from pentimento.diagnosis.evidence import Evidence
from pentimento.diagnosis.rule import DEFAULT_RULE

PAGE = (Path(__file__).parents[2] / "docs/diagnosis.md").read_text(encoding="utf-8").replace("−", "-")


def table(head: str) -> list[list[str]]:
    """Cells of the table below a row that begins with ``head``."""
    rows = PAGE.partition(f"| {head} |")[2].partition("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def test_weights_are_those_of_the_decision() -> None:
    intercepts = re.search(r"intercept is\s+([\d.-]+\d), of pushes\s+([\d.-]+\d)", PAGE)
    assert intercepts is not None
    for column, (kind, intercept) in enumerate(zip(("strokes", "pushes"), intercepts.groups(), strict=True), -2):
        decision = default_decision(kind)
        written = {row[0].strip("`"): float(row[column]) for row in table("evidence | formula")}
        names = [name.removeprefix("log_") for name in FEATURES]
        assert written == pytest.approx(dict(zip(names, decision.weights, strict=True)), abs=5.1e-4)
        assert float(intercept) == pytest.approx(decision.intercept, abs=5.1e-4)


def test_limits_are_those_of_the_rule() -> None:
    written = {
        name: float(value)
        for names, values, _ in table("limit | value")
        for name, value in zip(re.findall(r"\w+", names), values.split(", "), strict=True)
    }
    rule = asdict(DEFAULT_RULE)
    assert written | {"established": rule["established"], "suspected": rule["suspected"]} == rule


def test_worked_example_adds_up_to_its_probability() -> None:
    *terms, total = table("evidence | value")
    values = {
        name: float(value)
        for names, written, *_ in terms[1:]
        for name, value in zip(re.findall(r"\w+", names), written.split(", "), strict=True)
    }
    products = [float(row[-2]) for row in terms]
    logit = float(total[-2])
    assert sum(products) == pytest.approx(logit, abs=0.005)
    assert default_decision("strokes").probability(Evidence(**values)) == pytest.approx(
        1 / (1 + np.exp(-logit)), abs=1e-4
    )
