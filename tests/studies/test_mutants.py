"""Mutants differ from the module in one place; tests that look are told from tests that do not."""

import ast
from pathlib import Path

import numpy as np
import pytest

from studies.mutants import draw, is_noticed, mirror_of, mutants, passes

MODULE = Path("src/pentimento/clay/depth.py")
TEXT = '''"""Depths, in % of 100."""
from typing import Literal

def clipped(ä: float, at: Literal[3] = 3) -> float:  # at < 3
    """At most 2."""
    if ä is not None and ä > (1):
        return ä - 0.5
    return f"{ä + 1}"
'''


def test_each_mutant_is_one_piece_of_the_module_written_otherwise() -> None:
    found = list(mutants(MODULE, TEXT))
    assert [(mutant.before, mutant.after, mutant.line) for mutant in found] == [
        ("3", "4", 4),
        ("ä is not None and ä > (1)", "not (ä is not None and ä > (1))", 6),
        ("and", "or", 6),
        ("is not", "is", 6),
        (">", "<=", 6),
        ("1", "2", 6),
        ("-", "+", 7),
        ("0.5", "1.0", 7),
    ]
    for mutant in found:
        assert ast.dump(ast.parse(mutant.text)) != ast.dump(ast.parse(TEXT))
        assert len(mutant.text) - len(TEXT) == len(mutant.after) - len(mutant.before)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """One that looks at half of what it should."""
    for name, text in {
        MODULE: "def depth(a, b):\n    return a - b if a > b else b * 3\n",
        mirror_of(MODULE): "from pentimento.clay.depth import depth\ndef test():\n    assert depth(3, 1) == 2\n",
        Path("src/pentimento/clay/untested.py"): "X = 1 + 1\n",
        Path("src/pentimento/clay/__init__.py"): "",
        Path("src/pentimento/__init__.py"): "",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_what_nobody_looks_at_lives(project: Path) -> None:
    text = (project / MODULE).read_text()
    assert passes(MODULE, project)
    noticed = {
        (mutant.before, mutant.after): is_noticed(mutant, project)
        for mutant in mutants(MODULE, text)
        if len(mutant.before) == 1
    }
    assert noticed == {("-", "+"): True, (">", "<="): True, ("*", "/"): False, ("3", "4"): False}
    assert (project / MODULE).read_text() == text


def test_a_draw_is_of_tested_modules_without_repeats(project: Path) -> None:
    drawn = draw(project, 100, np.random.default_rng(0))
    assert {mutant.module for mutant in drawn} == {MODULE}
    assert len({(mutant.line, mutant.before, mutant.after) for mutant in drawn}) == len(drawn) == 5


def test_a_module_s_tests_mirror_it() -> None:
    assert mirror_of(MODULE) == Path("tests/clay/test_depth.py")
