"""What is printed reaches terminals of any encoding, and what is written is UTF-8 on all of them."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
IN_ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def test_a_letter_that_the_terminal_lacks_is_printed_as_its_number() -> None:
    command = [sys.executable, "-m", "pentimento.cli.main", "import", "×.csv", "--out", "x", "--tool", "y"]
    done = subprocess.run(
        [*command, "--photos", "z", "--scale", "1 px/mm"],
        env=os.environ | IN_ASCII, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert ".csv cannot be opened" in done.stderr and "Traceback" not in done.stderr
    code = "from pentimento.contracts.output import escape_unknown_letters as e; e(); print(2, chr(215))"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | IN_ASCII, capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "2 \\xd7\n"


def text_calls(tree: ast.AST) -> list[ast.Call]:
    """Calls of methods that read or write text."""
    return [
        call
        for call in ast.walk(tree)
        if isinstance(call, ast.Call)
        and isinstance(call.func, ast.Attribute)
        and (call.func.attr == "write_text" or (call.func.attr == "read_text" and not call.args))
    ]


@pytest.mark.parametrize("folder", ["src", "pipelines"])
def test_files_are_read_and_written_in_utf_8_whatever_the_locale(folder: str) -> None:
    found = [
        f"{file.relative_to(ROOT)}:{call.lineno}"
        for file in (ROOT / folder).rglob("*.py")
        for call in text_calls(ast.parse(file.read_text(encoding="utf-8")))
        if not any(word.arg == "encoding" for word in call.keywords)
    ]
    assert not found
