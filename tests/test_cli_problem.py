"""`pentimento diagnose --problem`: a simulator of the user's own."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.errors import ContractError
from pentimento.diagnosis.problem import Cause, Quantity
from pentimento.diagnosis.simulator import SimulatorProblem
from pipelines._imports import ROOT
from tests.diagnosis.spring import spring

TOY = "tests.diagnosis.spring"


def _run(tmp_path: Path, problem: str, *more: str) -> int:
    log = tmp_path / "log.npz"
    log.touch()
    return main(["diagnose", str(log), "--problem", problem, "--out", str(tmp_path / "out"), *more])


def test_a_problem_of_ones_own_gets_a_verdict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(tmp_path, f"{TOY}:worn_spring") == 0
    content = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert [entry["cause"] for entry in content["established"]] == ["wear"]
    assert content["text"] in capsys.readouterr().out


@pytest.mark.parametrize(
    ("problem", "said"),
    [
        ("spring", "not of the form module:function"),
        ("no_such_module:problem", "cannot be imported"),
        ("mine/pend/pendulum.py:problem", "write --problem mine.pend.pendulum:problem, from the current folder"),
        ("./pendulum.py:problem", "write --problem pendulum:problem, from the current folder"),
        ("/other/pendulum.py:problem", "go to /other and write --problem pendulum:problem"),
        (f"{TOY}:no_such_function", "has no function no_such_function"),
    ],
)
def test_a_wrong_problem_ends_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], problem: str, said: str
) -> None:
    assert _run(tmp_path, problem) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_options_of_tables_do_not_go_with_a_problem(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        _run(tmp_path, f"{TOY}:worn_spring", "--kind", "strokes")
    assert "--kind is for strokes or pushes" in capsys.readouterr().err


def cart_log(path: Path, pushes: int) -> None:
    """A log as docs/diagnose_your_simulator.md describes it: the grease is thinner where it is warm."""
    rng = np.random.default_rng(4)
    action = np.concatenate([np.arange(pushes), np.arange(pushes // 6)])
    speed, temperature = rng.uniform(0.3, 1.2, pushes)[action], rng.uniform(15, 25, len(action))
    times = np.linspace(0.1, 1.5, 8)
    drag = (1.1 / (1 + 0.025 * (temperature - 20)))[:, None]
    read = 1e3 * speed[:, None] / drag * (1 - np.exp(-drag * times)) + rng.normal(0, 1.5, (len(action), 8))
    np.savez(path, action=action, speed_m_s=speed, temperature_c=temperature, read_mm=read)


@pytest.mark.parametrize(("pushes", "is_few"), [(80, False), (30, True)])
def test_the_documented_problem_runs_and_few_actions_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], pushes: int, is_few: bool
) -> None:
    page = (ROOT / "docs/diagnose_your_simulator.md").read_text(encoding="utf-8")
    (snippet,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    module = f"documented_cart_{pushes}"
    (tmp_path / f"{module}.py").write_text(snippet, encoding="utf-8")
    cart_log(tmp_path / "log.npz", pushes)
    monkeypatch.chdir(tmp_path)
    assert main(["diagnose", "log.npz", "--problem", f"{module}:problem", "--out", "out"]) == 0
    content = json.loads((tmp_path / "out/verdict.json").read_text())
    assert [entry["cause"] for entry in content["established"]] == ["warm_grease"]
    warning = "There are 30 different actions; with fewer than about 60"
    assert (warning in capsys.readouterr().err) == (warning in content["text"]) == is_few


def test_arrays_without_a_problem_are_told_the_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.npz").touch()
    assert main(["diagnose", str(tmp_path / "log.npz"), "--out", str(tmp_path / "out")]) == 1
    assert "add --problem MODULE:FUNCTION" in capsys.readouterr().err


def _flat(problem: SimulatorProblem) -> dict[str, Any]:
    def flat_predict(index: Any, value: Any) -> Any:
        return problem.predict(index, value).mean(1)

    return {"predict": flat_predict}


def _misspelt(problem: SimulatorProblem) -> dict[str, Any]:
    def asks(index: Any, value: Any) -> Any:
        return problem.predict(index, value) + value["delays"]

    return {"predict": asks}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_flat, r"flat_predict returns the shape \(126,\) for 126 rows; expected is \(126, 16\)"),
        (_misspelt, "asks for 'delays', which is neither .*; there are .*delay_s"),
        (lambda p: {"measured": p.measured[0]}, r"it is \[B, N\]"),
        (lambda p: {"measured": p.measured[:5]}, "action of Rows has the shape .* measured has 5 rows"),
        (
            lambda p: {"causes": {"heat": Cause("heat", (Quantity("q", "1", 1.0),), ("temperature",))}},
            "cause heat has the covariate 'temperature', which Rows lacks; it has .*temperature_c",
        ),
    ],
)
def test_a_mistake_in_a_problem_is_named(change: Any, said: str) -> None:
    problem = spring()
    with pytest.raises(ContractError, match=said):
        replace(problem, **change(problem)).fit(())
