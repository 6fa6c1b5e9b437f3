"""Two methods on the same worlds: `python -m studies.blind.paired LINES OTHER_LINES`.

Both files are written by `studies.blind.table` with the same `--commit`, the other one by the code of another commit.
Worlds that only one of them has are left out. p is of an exact McNemar test.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from scipy.stats import binomtest

from studies.blind.score_card import Line, any_name, by_series, exact, hidden, named, outside_found
from studies.blind.table import read_lines

_RIGHT: dict[str, Callable[[Line], bool]] = {
    "none": lambda line: not any_name(line),
    "outside": lambda line: outside_found(line) and not any_name(line),
}
"""When a world of a series counts as right; in the other series, when exactly the hidden causes are named."""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind.paired", description=__doc__)
    parser.add_argument("lines", type=Path)
    parser.add_argument("other_lines", type=Path)
    given = parser.parse_args()
    print(table(read_lines(given.lines), read_lines(given.other_lines)))


def table(lines: Sequence[Line], other_lines: Sequence[Line]) -> str:
    """Markdown: how many worlds of each series each method has right, and p of the difference."""
    other = {(line["series"], line["seed"]): line for lines in by_series(other_lines).values() for line in lines}
    rows = ["| series | worlds | right | right, other | only here | only there | p |", "|---|---|---|---|---|---|---|"]
    false = [0, 0]
    for series, own in by_series(lines).items():
        right = _RIGHT.get(series, exact)
        pairs = [(line, other[series, line["seed"]]) for line in own if (series, line["seed"]) in other]
        here, there = (sum(right(pair[k]) and not right(pair[1 - k]) for pair in pairs) for k in (0, 1))
        both = sum(right(a) and right(b) for a, b in pairs)
        p = binomtest(here, here + there).pvalue if here + there else 1.0
        rows.append(f"| {series} | {len(pairs)} | {both + here} | {both + there} | {here} | {there} | {p:.2f} |")
        for k in (0, 1):
            false[k] += sum(len(set(named(pair[k].get("verdict"))) - set(hidden(pair[k]))) for pair in pairs)
    return "\n".join([*rows, "", f"False names: {false[0]} here, {false[1]} there."])


if __name__ == "__main__":
    main()
