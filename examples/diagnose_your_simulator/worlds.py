"""How often the arm's fault is named: `python -m examples.diagnose_your_simulator.worlds --seeds 0 40`.

Each world hides one of five faults, nothing included, at half to twice its usual strength. Bounded least squares over
all parameters and quantities, the usual system identification, stands beside it: it gives every fault a value.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator

import numpy as np
from scipy.optimize import least_squares

from examples.diagnose_your_simulator.arm import CAUSES, problem_of
from examples.diagnose_your_simulator.robot import drawn_fault, make_log
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.simulator import FittedSimulator, SimulatorProblem

_ABOVE = 0.1
"""Typical sizes from which a quantity of the least squares counts as named."""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m examples.diagnose_your_simulator.worlds", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 40), metavar=("FIRST", "END"))
    rows = list(worlds(*parser.parse_args().seeds))
    exact, false, named = (sum(row[k] for row in rows) for k in range(3))
    fitted_exact = sum(row[3] for row in rows)
    print(f"exactly named: {exact} of {len(rows)}; false names: {false} of {named}; least squares: {fitted_exact}")


def worlds(first: int, end: int) -> Iterator[tuple[bool, int, int, bool]]:
    """For each world: whether it is exactly named, its false names, its names, and whether least squares is exact."""
    for seed in range(first, end):
        fault, strength = drawn_fault(seed)
        problem = problem_of(make_log(fault, seed, strength), 0)
        truth = set() if fault == "nothing" else {fault}
        found = diagnose(problem, seed=0, log=lambda line: None)
        names = {finding.cause for finding in found.established}
        fitted = named_by_least_squares(problem)
        suspected = [finding.cause for finding in found.suspected]
        print(
            f"{seed}: hidden {fault} ({strength:.2f}), established {_listed(names)}, suspected {_listed(suspected)}, "
            f"least squares {_listed(fitted)}",
            flush=True,
        )
        yield names == truth, len(names - truth), len(names), fitted == truth


def _listed(causes: Iterable[str]) -> str:
    return ", ".join(sorted(causes)) or "nothing"


def named_by_least_squares(problem: SimulatorProblem) -> set[str]:
    """The causes with a value above a tenth of their typical size in a bounded fit of everything."""
    names = tuple(cause.name for cause in CAUSES)
    low = [-np.inf] * len(problem.parameters) + [-np.inf if q.signed else 0.0 for c in CAUSES for q in c.quantities]

    def residuals(vector: np.ndarray) -> np.ndarray:
        return np.ravel(
            problem.measured - problem.predict(problem.index, problem.values(FittedSimulator(names, vector)))
        )

    start = np.full(len(low), _ABOVE)  # not at a bound, and large enough for relative steps
    found = least_squares(residuals, start, bounds=(low, np.inf), diff_step=0.01, max_nfev=12)
    fitted = FittedSimulator(names, found.x)
    sizes = {c.name: max(abs(problem.values(fitted)[q.name]) / q.typical for q in c.quantities) for c in CAUSES}
    return {name for name, size in sizes.items() if size > _ABOVE}


if __name__ == "__main__":
    main()
