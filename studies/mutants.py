"""Mutation score of the tests: `python -m studies.mutants [--count 60] [--seed 0]`.

Mutants come from Cosmic Ray (https://cosmic-ray.readthedocs.io). The seed draws a fixed sample of single mutations of
src/. Each is applied in a copy of the project, and the tests of its module (tests/ mirrors src/) are run. A mutant
whose tests fail or time out is killed. Some survivors are equivalent to the original: a bound, a tolerance, a figure's
margin.

A line for each mutant and the score go to the screen and to ``--out``.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cosmic_ray.plugins
import numpy as np
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.testing import run_tests
from cosmic_ray.work_item import MutationSpec, TestOutcome

ROOT = Path(__file__).resolve().parents[1]
SOURCE = Path("src/pentimento")
_OPERATORS = (
    "ReplaceComparisonOperator", "ReplaceBinaryOperator", "ReplaceUnaryOperator", "ReplaceAndWithOr",
    "ReplaceOrWithAnd", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak", "AddNot", "NumberReplacer", "ZeroIterationForLoop",
)  # fmt: skip
"""Prefixes of the names of Cosmic Ray's operators. Decorators stay: without `njit` a kernel is only slower."""
_EXCLUDED = re.compile(r"Bit|Shift|_(Eq|NotEq|Lt|LtE|Gt|GtE)_Is")
"""`|` is mostly a union of types, which is not evaluated; the other replacements raise TypeError for floats."""
_FIRST_LIMIT_S = 600.0  # of a module's tests without a mutant
_SLOWER, _START_S = 5.0, 60.0  # a mutant's limit: so many times that duration, and the start of a process


@dataclass(frozen=True)
class Score:
    """Counts of a sample of mutants."""

    mutants: int
    killed: int
    timed_out: int
    """Of the killed ones."""
    untested: int
    """Not in `mutants`: the module's tests fail without a mutant."""

    def __str__(self) -> str:
        share = self.killed / self.mutants if self.mutants else 0.0
        return (
            f"{self.killed} of {self.mutants} mutants killed ({share:.0%}), {self.timed_out} of them by time-out; "
            f"{self.untested} more in modules whose tests fail without a mutant."
        )


def main() -> int:
    """Command line; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("data/studies/mutants.txt"))
    args = parser.parse_args()
    out = args.out.resolve()
    out.parent.mkdir(parents=True, exist_ok=True)
    ignored = shutil.ignore_patterns(
        ".git", ".venv", ".dvc", ".profiles", ".pentimento", "data", "__pycache__", "mlflow*"
    )
    with tempfile.TemporaryDirectory() as temporary, out.open("w", encoding="utf-8") as file:
        folder = Path(temporary) / "project"
        shutil.copytree(ROOT, folder, ignore=ignored)
        os.environ["PYTHONPATH"] = f"{folder}{os.pathsep}{folder / 'src'}"
        with contextlib.chdir(folder):
            for line in results(sample(args.count, np.random.default_rng(args.seed))):
                print(line, flush=True)
                print(line, file=file, flush=True)
    return 0


def sample(count: int, rng: np.random.Generator) -> list[MutationSpec]:
    """Draw different mutations of the project in the working directory.

    Modules with tests are drawn in proportion to their lines, then a place in the module, then a mutation of it.
    """
    modules = [module for module in sorted(SOURCE.rglob("*.py")) if mirrored_tests(module).exists()]
    lines = np.array([len(module.read_text(encoding="utf-8").splitlines()) for module in modules], dtype=np.float64)
    places: dict[Path, list[list[MutationSpec]]] = {}
    drawn: list[MutationSpec] = []
    while len(drawn) < count and modules:
        at = int(rng.choice(len(modules), p=lines / lines.sum()))
        module = modules[at]
        left = places.setdefault(module, _places(module))
        if not left:
            del modules[at]
            lines = np.delete(lines, at)
            continue
        same_place = left.pop(int(rng.integers(len(left))))
        drawn.append(same_place[int(rng.integers(len(same_place)))])
    return drawn


def results(mutations: list[MutationSpec]) -> Iterator[str]:
    """Run the tests for each mutation; yields a line for each, and the score at the end."""
    durations: dict[Path, float | None] = {}
    killed = timed_out = untested = 0
    for mutation in mutations:
        tests = mirrored_tests(mutation.module_path)
        if tests not in durations:
            durations[tests] = _duration(tests)
        duration = durations[tests]
        if duration is None:
            untested += 1
            yield f"untested {mutation.module_path}: {tests} fails without a mutant"
            continue
        result = mutate_and_test([mutation], _command(tests), _SLOWER * duration + _START_S)
        if result.test_outcome not in (TestOutcome.KILLED, TestOutcome.SURVIVED):
            raise RuntimeError(f"Cosmic Ray could not test {mutation}: {result.output}")
        killed += result.is_killed
        timed_out += result.output == "timeout"
        changed = [line[1:].strip() for line in (result.diff or "").splitlines()[3:] if line[:1] in ("+", "-")]
        yield f"{result.test_outcome.value} {mutation.module_path}:{mutation.start_pos[0]}: {' -> '.join(changed)}"
    yield str(Score(len(mutations) - untested, killed, timed_out, untested))


def mirrored_tests(module: Path) -> Path:
    """The test file of a module."""
    within = module.relative_to(SOURCE)
    return Path("tests") / within.parent / f"test_{within.name}"


def _places(module: Path) -> list[list[MutationSpec]]:
    """All mutations of a module, those of one place together, in the order of the text."""
    nodes = list(ast_nodes(get_ast_from_path(module)))
    places: dict[tuple[int, int], list[MutationSpec]] = {}
    for name in sorted(cosmic_ray.plugins.operator_names()):
        short = name.partition("/")[2]
        if not short.startswith(_OPERATORS) or _EXCLUDED.search(short):
            continue
        operator = cosmic_ray.plugins.get_operator(name)()
        positions = [position for node in nodes for position in operator.mutation_positions(node)]
        for occurrence, (start, end) in enumerate(positions):
            places.setdefault(start, []).append(MutationSpec(module, name, occurrence, start, end))
    return [places[start] for start in sorted(places)]


def _duration(tests: Path) -> float | None:
    """Seconds that the tests take without a mutant; None where they fail."""
    began = time.perf_counter()
    outcome, _ = run_tests(_command(tests), _FIRST_LIMIT_S)
    return time.perf_counter() - began if outcome == TestOutcome.SURVIVED else None


def _command(tests: Path) -> str:
    return f"{sys.executable} -m pytest -x -q -p no:cacheprovider {tests}"


if __name__ == "__main__":
    sys.exit(main())
