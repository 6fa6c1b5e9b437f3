"""Whether the tests notice a wrong line: `python -m studies.mutants`.

One place in the code is made wrong at a time, drawn at random over the lines of src/: a comparison, a sign, a number, a
condition. The tests of that module (tests/ mirrors src/) are run in a copy of the project. A mutant that they let pass
is shown, so that a reader can say whether it is wrong in any way that matters. Some are not: an equivalent bound, a
tolerance, a figure's margin.

A line for each mutant goes to the screen and to ``--out``.
"""

from __future__ import annotations

import argparse
import ast
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines._io import end_with_parent

ROOT = Path(__file__).resolve().parents[1]
SOURCE = Path("src/pentimento")
_SWAPPED: dict[type[ast.AST], tuple[str, str]] = {
    ast.Lt: ("<", ">="), ast.LtE: ("<=", ">"), ast.Gt: (">", "<="), ast.GtE: (">=", "<"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"),
    ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"), ast.And: ("and", "or"), ast.Or: ("or", "and"),
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.MatMult: ("@", "+"),
}  # fmt: skip
"""As an operator is written, and as a mutant has it."""
_LIMIT_S = 300.0


@dataclass(frozen=True)
class Mutant:
    """A module with one piece of its text replaced."""

    module: Path
    """Below the project's folder."""
    line: int
    before: str
    after: str
    text: str
    """The whole module."""


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("data/studies/mutants.txt"))
    given = parser.parse_args()
    drawn = draw(ROOT, given.count, np.random.default_rng(given.seed))
    given.out.parent.mkdir(parents=True, exist_ok=True)
    sound = dict[Path, bool]()
    killed = counted = 0
    with tempfile.TemporaryDirectory() as temporary, given.out.open("w", encoding="utf-8") as file:

        def say(line: str) -> None:
            print(line, flush=True)
            print(line, file=file, flush=True)

        folder = Path(temporary) / "project"
        unneeded = shutil.ignore_patterns(
            ".git", ".venv", ".dvc", ".profiles", ".pentimento", "data", "__pycache__", "mlflow*"
        )
        shutil.copytree(ROOT, folder, ignore=unneeded)
        for mutant in drawn:
            if mutant.module not in sound:
                sound[mutant.module] = passes(mutant.module, folder)
            if not sound[mutant.module]:
                say(f"not counted, {mirror_of(mutant.module)} fails without a mutant")
                continue
            noticed = is_noticed(mutant, folder)
            counted += 1
            killed += noticed
            said = "killed" if noticed else "LIVES "
            say(f"{said} {mutant.module}:{mutant.line}: {mutant.before} -> {mutant.after}")
        say(f"{killed} of {counted} killed.")
    return 0


def draw(root: Path, count: int, rng: np.random.Generator) -> list[Mutant]:
    """So many mutants, each place of all modules that have tests as likely as any other."""
    modules = [path.relative_to(root) for path in sorted((root / SOURCE).rglob("*.py"))]
    places = [
        mutant
        for module in modules
        if (root / mirror_of(module)).exists()
        for mutant in mutants(module, (root / module).read_text(encoding="utf-8"))
    ]
    return [places[at] for at in rng.choice(len(places), min(count, len(places)), replace=False)]


def mirror_of(module: Path) -> Path:
    """Where the tests of a module lie."""
    within = module.relative_to(SOURCE)
    return Path("tests") / within.parent / f"test_{within.name}"


def mutants(module: Path, text: str) -> Iterator[Mutant]:
    """Every mutant of a module."""
    lines = text.splitlines(keepends=True)
    begins = np.concatenate([[0], np.cumsum([len(line.encode()) for line in lines])])
    data = text.encode()

    def at(line: int, column: int) -> int:
        return int(begins[line - 1]) + column

    def mutant(line: int, start: int, end: int, after: str) -> Mutant:
        changed = data[:start] + after.encode() + data[end:]
        return Mutant(module, line, data[start:end].decode(), after, changed.decode())

    def between(left: ast.expr, right: ast.expr, operator: ast.AST) -> Iterator[Mutant]:
        start = at(left.end_lineno or 0, left.end_col_offset or 0)
        written = data[start : at(right.lineno, right.col_offset)].decode()
        symbol, after = _SWAPPED.get(type(operator), ("", ""))
        if symbol and written.count(symbol) == 1 and "#" not in written:
            begin = start + len(written[: written.index(symbol)].encode())
            yield mutant(left.end_lineno or 0, begin, begin + len(symbol), after)

    for node in _computing(ast.parse(text)):
        if isinstance(node, ast.Compare):
            for left, operator, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
                yield from between(left, right, operator)
        elif isinstance(node, ast.BinOp):
            yield from between(node.left, node.right, node.op)
        elif isinstance(node, ast.BoolOp):
            yield from between(node.values[0], node.values[1], node.op)
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            start, end = at(node.lineno, node.col_offset), at(node.end_lineno or 0, node.end_col_offset or 0)
            after = repr(node.value + 1) if isinstance(node.value, int) else repr(node.value * 2 or 1.0)
            yield mutant(node.lineno, start, end, after)
        elif isinstance(node, ast.If | ast.IfExp):
            test = node.test
            start, end = at(test.lineno, test.col_offset), at(test.end_lineno or 0, test.end_col_offset or 0)
            yield mutant(test.lineno, start, end, f"not ({data[start:end].decode()})")


def _computing(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes below that compute: annotations, what is for type checkers alone, and sentences are left out."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.If) and ast.unparse(child.test) in ("TYPE_CHECKING", "__name__ == '__main__'"):
                continue
            if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr):
                yield child
                yield from _computing(child)


def is_noticed(mutant: Mutant, folder: Path) -> bool:
    """Whether the module's tests fail, or do not end, with the mutant in the copy of the project in ``folder``."""
    place = folder / mutant.module
    sound = place.read_text(encoding="utf-8")
    place.write_text(mutant.text, encoding="utf-8")
    try:
        return not passes(mutant.module, folder)
    finally:
        place.write_text(sound, encoding="utf-8")


def passes(module: Path, folder: Path) -> bool:
    """Whether the tests of the module end well in the copy of the project in ``folder``."""
    try:
        ran = subprocess.run(
            [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", str(mirror_of(module))],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{folder / 'src'}", "PYTHONDONTWRITEBYTECODE": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=_LIMIT_S,
            check=False,
            preexec_fn=end_with_parent,
        )
    except subprocess.TimeoutExpired:
        return False
    return ran.returncode == 0


if __name__ == "__main__":
    sys.exit(main())
