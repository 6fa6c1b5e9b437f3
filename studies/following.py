"""Robots that follow late and bristles that lag: `python -m studies.following [--worlds 40] [--out FILE]`.

Worlds of the virtual studio hide a following error of the robot, a lag of the bristles, both or neither, in turn. Each
table of 56 strokes is diagnosed twice: with the robot's measured paths and without. A world is right if both answers
are: the robot is late or not, the bristles lag or not. Each diagnosis's line is appended to FILE and not made again.
"""

import argparse
import itertools
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from pentimento.contracts.schema import arrow_schema
from pentimento.contracts.strokes import CONTRACT
from pentimento.diagnosis.diagnose import diagnose
from pentimento.diagnosis.strokes.measured import load_measured
from pentimento.diagnosis.strokes.problem import stroke_problem
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from studies.blind.strokes.collect import record_world
from studies.blind.strokes.design import view_of
from studies.blind.strokes.make import commands_of
from studies.blind.strokes.worlds import ToolName, sketch_world

HIDDEN = ((), ("latency",), ("bristle_lag",), ("latency", "bristle_lag"))
TOOLS: tuple[ToolName, ...] = ("round_brush", "flat_brush")
FIRST_SEED = 7000
SHEETS = (0, 2)
"""Of the design, which share their repeated actions."""
STRENGTHS = {"latency": (0.2, 1.0), "bristle_lag": (0.08, 0.6)}
"""Log-uniform: delays of 12 to 60 ms, trails of 0.5 to 5 mm at high press."""

Way = Literal["measured", "commanded"]
WAYS: tuple[Way, ...] = ("measured", "commanded")
Line = dict[str, Any]


def world_table(number: int) -> tuple[dict[str, float], pa.Table]:
    """Hidden strengths of a world, and its strokes."""
    seed, hidden = FIRST_SEED + number, HIDDEN[number % len(HIDDEN)]
    rng = np.random.default_rng([seed, 5])
    sketch = sketch_world("none", seed, None, TOOLS[number // len(HIDDEN) % len(TOOLS)])
    strengths = {name: float(np.exp(rng.uniform(*np.log(STRENGTHS[name])))) for name in hidden}
    tool = sketch.world.tool
    # Bent bristles lie down in proportion to the strength, as in the blind benchmark.
    tool = replace(tool, elongation=tool.elongation * strengths.get("bristle_lag", 0.0))
    world = replace(sketch.world, tool=tool, effects=replace(sketch.world.effects, **strengths))
    view = view_of(sketch.tool, fine=False)
    commands = [command for command in commands_of(sketch, view) if command.sheet in SHEETS]
    rows = record_world(world, seed, sketch.tool, palette_srgb=sketch.palette_srgb, commands=commands, view=view).rows
    return strengths, pa.Table.from_pylist(rows, schema=arrow_schema(CONTRACT, include_optional=set(rows[0])))


def line_of(number: int, way: Way) -> Line:
    """The causes that the diagnosis of a world's table establishes; a measured delay counts as latency."""
    hidden, table = world_table(number)
    measured = load_measured(table if way == "measured" else table.drop_columns(["measured_path"]))
    result = diagnose(stroke_problem(measured, VOCABULARY, 0), seed=0, log=lambda line: None)
    late = ["latency"] if measured.following is not None and measured.following.late else []
    causes = [*late, *(finding.cause for finding in result.established)]
    delay_s = None if measured.following is None else measured.following.delay_s
    return {"world": number, "way": way, "hidden": hidden, "causes": causes, "delay_s": delay_s}


def is_right(line: Line) -> bool:
    """Whether both questions are answered rightly."""
    return all((name in line["hidden"]) == (name in line["causes"]) for name in STRENGTHS)


def summary(lines: Sequence[Line]) -> str:
    """A table: right worlds by what they hide, with and without measured paths."""
    text = ["| hidden | right with measured paths | right without |", "|---|---|---|"]
    groups = {
        " and ".join(hidden) or "neither": [line for line in lines if set(line["hidden"]) == set(hidden)]
        for hidden in HIDDEN
    }
    for name, group in (groups | {"all": list(lines)}).items():
        right = {way: [is_right(line) for line in group if line["way"] == way] for way in WAYS}
        text.append(f"| {name} | " + " | ".join(f"{sum(each)} of {len(each)}" for each in right.values()) + " |")
    return "\n".join(text) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.following", description=__doc__)
    parser.add_argument("--worlds", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("data/studies/following.jsonl"))
    args = parser.parse_args()
    args.out.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.loads(text) for text in args.out.read_text().splitlines()] if args.out.exists() else []
    for way, number in itertools.product(WAYS, range(args.worlds)):
        if not any(line["world"] == number and line["way"] == way for line in lines):
            lines.append(line_of(number, way))
            with args.out.open("a") as file:
                file.write(json.dumps(lines[-1]) + "\n")
    print(summary(lines))


if __name__ == "__main__":
    main()
