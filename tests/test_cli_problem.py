"""`pentimento diagnose --problem`: a simulator of the user's own."""

import json
from pathlib import Path

import pytest

from pentimento.cli.main import main

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
