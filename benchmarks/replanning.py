"""What replanning costs the runner: an iteration of the descent by the bundle's graphs, and the way to a first stroke.

`python -m benchmarks.replanning` measures in a process without PyTorch, in turns with the workshop's PyTorch in
another one: the same strokes, the same compiled renderer; only brush and encoder differ. An iteration is one
of `planning.descent.descend`: strokes rendered, compared, differentiated and moved. Bars are measured by the fastest
one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pentimento.bundle.graphs import GraphBrush, GraphMeaning, Graphs
from pentimento.bundle.reader import Bundle, open_bundle
from pentimento.contracts.images import write_png
from pentimento.control.checkpoint import has_state, load_state
from pentimento.planning.objectives import Objective
from pentimento.planning.strokes.bezier import with_color
from pentimento.planning.strokes.brush import Brush
from pentimento.planning.strokes.config import PRINT_ALONE, PlannerConfig, TextConfig
from pentimento.planning.strokes.descent import descend
from pentimento.planning.strokes.initialise import random_strokes
from pentimento.planning.strokes.render_plan import faults
from pentimento.planning.strokes.scene import Meaning, Scene, objective_for, scene_with
from pentimento.planning.strokes.target import fit_to_canvas, load_photograph
from pentimento.robots.tools import Tool

Array = NDArray[np.float32]

STROKES, SIDE_PX = 100, 128
THREADS = (1, 2)
WEIGHTS = {"semantic": 0.1, "text": 0.02}
WORDS = "a cat"
BAR_MS = {False: 10.0, True: 60.0}
"""For an iteration, without and with the objectives of meaning, semantic and text."""
SETTING, FIRST_STROKE_BAR_S = "marker", 10.0
PICTURE = "chelsea"
_ROUNDS, _STEPS, _WARM, _SEED = 4, 15, 3, 1
"""So many turns each, and in each so many iterations that count, after some that do not."""


class Case(NamedTuple):
    """A brush of the bundle, with or without the objectives of meaning, on so many threads."""

    brush: str
    meaning: bool
    threads: int


Steps = tuple[list[list[float]], float]
"""Of each iteration, ms by the clock and ms of the processor in all threads; and the objective before the first."""
Parts = Callable[[Case], tuple[Brush, Meaning]]
"""The brush of a case, and the encoder."""


def by_graphs(bundle: Bundle) -> Parts:
    """The runner's way."""
    graphs = {threads: Graphs(bundle, threads) for threads in THREADS}

    def parts(case: Case) -> tuple[Brush, Meaning]:
        return GraphBrush(graphs[case.threads], case.brush), GraphMeaning(graphs[case.threads], _SEED)

    return parts


def by_torch(bundle: Bundle, models: Path) -> Parts:
    """The workshop's way, with the models that the bundle was made of."""
    import torch

    from pentimento.dynamics.strokes.extended import read_stroke_model
    from pentimento.dynamics.strokes.planned import TorchBrush
    from pentimento.semantics.encoder import Encoder
    from pentimento.semantics.objective import EncoderMeaning

    torch.use_deterministic_algorithms(True)  # as the pipeline has it, and the graphs, too
    encoder, views = Encoder.load(models / "semantics/weights"), bundle.manifest.encoder.views

    def parts(case: Case) -> tuple[Brush, Meaning]:
        torch.set_num_threads(case.threads)
        [name] = bundle.manifest.graphs[f"{case.brush}_marks"].models
        model, (tool, planner) = read_stroke_model(models / name / "weights"), _painted_with(bundle, case.brush)
        return TorchBrush(model, tool, planner.path_points), EncoderMeaning(encoder, views, _SEED)

    return parts


def measure(bundle: Bundle, parts: Parts, case: Case) -> Steps:
    """Time a case on a square of ``SIDE_PX``, at the scale of the brush's setting."""
    tool, planner = _painted_with(bundle, case.brush)
    target = fit_to_canvas(load_photograph(PICTURE), (SIDE_PX, SIDE_PX)).astype(np.float32)
    brush, meaning = parts(case)
    scene = scene_with(brush, tool, (SIDE_PX / planner.pixels_per_m,) * 2, target, meaning=meaning)
    wanted = PRINT_ALONE
    if case.meaning:
        wanted = replace(wanted, semantic_weight=WEIGHTS["semantic"], text=TextConfig(WEIGHTS["text"], WORDS))
    planner = replace(planner, objectives=wanted)
    scene = replace(scene, threads=case.threads)
    return time_steps(scene, planner, objective_for(scene, planner), STROKES, _STEPS)


def time_steps(scene: Scene, planner: PlannerConfig, objective: Objective, count: int, steps: int) -> Steps:
    """Move random strokes down an objective as replanning does, and time so many iterations."""
    tool, rng = scene.tool, np.random.default_rng(_SEED)
    strokes = random_strokes(count, tool, scene.canvas_size_m, rng)
    if tool.color_srgb is not None:
        strokes = with_color(strokes, np.tile(np.array(tool.color_srgb, np.float32), (count, 1)))
    strokes.keep_within(tool, scene.canvas_size_m, planner.edge_m)
    paper, rate, free_color = np.ones_like(scene.target), planner.replan_rate, tool.color_srgb is None
    values = descend(
        strokes, paper, scene, planner, objective=objective, iterations=_WARM + steps, free_color=free_color, rate=rate,
        last_rate=rate, fault=lambda _: faults(count, planner.execution_noise, rng),
    )  # fmt: skip
    marks = [(value, time.perf_counter(), time.process_time()) for value in values]
    return (1e3 * np.diff(marks[_WARM - 1 :], axis=0)[:, 1:]).tolist(), marks[0][0]


def first_stroke_s(folder: Path) -> float:
    """Seconds from the start of ``pentimento run`` with the bundle in ``folder`` to its first stroke."""
    with tempfile.TemporaryDirectory() as desk:
        goal, out = f"{desk}/goal.png", Path(desk) / "painting"
        write_png(Path(goal), load_photograph(PICTURE))
        words = [sys.executable, "-m", "pentimento.cli.main", "run", str(folder), "--goal-image", goal]
        words += ["--setting", SETTING, "--strokes", str(STROKES), "--out", str(out)]
        started = time.perf_counter()
        running = subprocess.Popen(words, stderr=subprocess.DEVNULL)  # which would say that it was interrupted
        while not (has_state(out) and load_state(out).executed):
            if running.poll() is not None:
                raise RuntimeError(f"`pentimento run {folder}` ended before its first stroke: try it by hand.")
            time.sleep(0.02)
        took_s = time.perf_counter() - started
        running.terminate()
        running.wait()
    return took_s


def _painted_with(bundle: Bundle, brush: str) -> tuple[Tool, PlannerConfig]:
    """The first setting that paints with a brush."""
    name, setting = next((n, s) for n, s in bundle.manifest.settings.items() if s.brush == brush)
    return bundle.tools[name], setting.planner


def _in_turns(bundle: Bundle, workshop: subprocess.Popen[str], cases: list[Case]) -> None:
    """Measure each case here and in the workshop, and print the table."""
    assert workshop.stdin is not None and workshop.stdout is not None
    parts = by_graphs(bundle)
    heads = ("runner: wall", "processor", "workshop: wall", "processor", "runner over")
    print(f"{'ms an iteration: median (best)':31}", *(f"{head:16}" for head in heads), "bar")
    for case in cases:
        turns = []
        for _ in range(_ROUNDS):
            ours = measure(bundle, parts, case)
            print(json.dumps(case), file=workshop.stdin, flush=True)
            turns.append((ours, json.loads(workshop.stdout.readline())))
        np.testing.assert_allclose(turns[0][0][1], turns[0][1][1], rtol=1e-4)
        here, there = (np.concatenate([ms for ms, _ in of]) for of in zip(*turns, strict=True))
        (median, best), (their_median, their_best) = ((np.median(ms, axis=0), ms.min(axis=0)) for ms in (here, there))
        bar = BAR_MS[case.meaning]
        figures = [*zip(median, best, strict=True), *zip(their_median, their_best, strict=True)]
        figures.append((median[0] / their_median[0], best[0] / their_best[0]))
        kind, met = "meaning" if case.meaning else "print", "yes" if best[0] <= min(bar, their_best[0]) else "NO"
        cells = [f"{middle:7.2f} ({minimum:6.2f})" for middle, minimum in figures]
        print(f"{case.brush:15} {kind:9} × {case.threads}  ", *cells, f"{bar:3.0f} {met}", flush=True)


def main() -> None:
    """Print the table; as the workshop, answer a line on stdin, a case, by one on stdout, its steps."""
    parser = argparse.ArgumentParser(prog="benchmarks.replanning", description="What replanning costs the runner.")
    parser.add_argument("--bundle", type=Path, default=Path("models/bundle"), help="beside its models")
    parser.add_argument("--workshop", action="store_true", help="measure PyTorch, for another process that asks")
    arguments = parser.parse_args()
    bundle = open_bundle(arguments.bundle)
    if arguments.workshop:
        parts = by_torch(bundle, arguments.bundle.parent)
        for line in sys.stdin:
            print(json.dumps(measure(bundle, parts, Case(*json.loads(line)))), flush=True)
        return
    print("load over 1, 5, 15 minutes: {:.1f}, {:.1f}, {:.1f}".format(*os.getloadavg()), f"of {os.cpu_count()} cores")
    cases = [Case(*case) for case in product(sorted(bundle.manifest.brushes), (False, True), THREADS)]
    words = [sys.executable, "-m", "benchmarks.replanning", "--workshop", *sys.argv[1:]]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as workshop:
        _in_turns(bundle, workshop, cases)
    assert "torch" not in sys.modules, "The runner's figures are those of a process without PyTorch."
    first, second = (first_stroke_s(arguments.bundle) for _ in range(2))
    print(f"start to first stroke: {first:.1f} s, then {second:.1f} s; bar {FIRST_STROKE_BAR_S:.0f} s",
          "yes" if second <= FIRST_STROKE_BAR_S else "NO")  # fmt: skip
    print("load afterwards: {:.1f}, {:.1f}, {:.1f}".format(*os.getloadavg()))


if __name__ == "__main__":
    main()
