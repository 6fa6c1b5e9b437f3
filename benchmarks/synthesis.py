"""What synthesising co-paintings costs: an iteration of the descent, and paintings an hour by one worker and by two.

`python -m benchmarks.synthesis` prints the section; it wants an idle machine.
"""

import os
import time
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from benchmarks.bars import Bar
from benchmarks.clock import in_turns
from benchmarks.peers import WHERE
from benchmarks.plain_adam import MODEL
from benchmarks.tables import bar_table, markdown
from pentimento.contracts.colour import srgb_to_linear
from pentimento.contracts.scenes import example_table
from pentimento.copainting.jobs import Submit, gather, worker_pool
from pentimento.copainting.synthesis.painter import Guidance, Painter, Setting, descend_guided, plan_painting
from pentimento.dynamics.strokes.extended import StrokeModel
from pentimento.dynamics.strokes.mechanisms.bristle_lag import BristleLag
from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.planning.strokes.brush import StrokeTiming
from pentimento.planning.strokes.config import no_log
from pentimento.planning.strokes.descent import optimise
from pentimento.planning.strokes.initialise import random_strokes
from pentimento.planning.strokes.scene import scene_with
from pentimento.planning.strokes.target import fit_to_canvas, load_photograph
from pentimento.robots.tools import load_tool
from pentimento.semantics.encoder import Encoder, new_model
from pentimento.semantics.objective import EncoderMeaning
from pentimento.semantics.tokenizer import learn_tokenizer
from pipelines._config import load_section
from pipelines.synthesize_copaintings import SynthesizeCopaintings
from pipelines.train_semantics import TrainSemantics

PARAMS = Path(__file__).resolve().parents[1] / "params.yaml"
SETTING = "colour12"
STROKES, SIDE_PX, VIEWS = 200, 168, 1
FRIDA_STROKES, FRIDA_S = 400, 3.68
"""FRIDA's renderer, forward + backward at 168², one thread (``peers.WHERE``); its time is linear in strokes."""
FRIDA_ITERATION_S = FRIDA_S * STROKES / FRIDA_STROKES
ITERATIONS = 500
"""Of a painting in the table; FRIDA's synthesis makes 300 to 700."""
LAG_M = 0.0056
"""Of the bristles, as diagnose_gap found it for the round brush: what extends the stroke model in synthesis."""
_TIMED_ITERATIONS, _ROUNDS = 20, 5
_PAINTINGS, _PAINTING_ROUNDS = 6, 2
_PICTURE = "chelsea"
_SEED = 1

_ABOUT = """\
An iteration is one of the real descent: {strokes} random strokes of a round brush through its diagnosed stroke model
(Traj2Stroke and bristle lag) on {side}² pixels, rendered, compared, differentiated and moved; one thread, the fastest
of several runs. *Guided* adds the semantic objective with {views} moved view, by an untrained encoder of the default
shape. FRIDA's figure is {frida} s for {frida_strokes} strokes at {side}², forward + backward of its **renderer alone**,
measured on other machines ({where}).
Its time is linear in strokes, so {iteration:.2f} s an iteration are taken for {strokes}; its objectives, its CLIP
losses and its optimiser come on top and are left out here, while ours are counted. Paintings an hour are for
{iterations} iterations each.

*Whole paintings* are of the setting `{setting}` as params.yaml has it, planned from a blank sheet with guidance.
Workers are started and warm before the clock runs; each is one thread of one process."""


def measure_synthesis() -> dict[str, Any]:
    """Seconds of an iteration without and with guidance, and of whole paintings by one worker and by two."""
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)  # as the stage and its workers do
    cv2.setNumThreads(1)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return {"cores": cores, "iteration": measure_iterations(), "workers": measure_workers()}


def measure_iterations() -> dict[str, float]:
    """Seconds of one iteration: ``print`` with the print objective only, ``guided`` with the semantic one, too."""
    setting = sized(SIDE_PX)
    config, guidance = setting.planner, replace(_guidance(setting), iterations=_TIMED_ITERATIONS, views=VIEWS)
    target = fit_to_canvas(load_photograph(_PICTURE), setting.planned_px).astype(np.float32)
    tool = load_tool(setting.tool)
    scene = scene_with(TorchBrush(_model(), tool, config.path_points), tool, setting.canvas_m, target)
    scene = replace(scene, meaning=EncoderMeaning(_encoder(), VIEWS, _SEED))
    paper = np.full_like(target, srgb_to_linear(np.array(setting.paper)))
    start = random_strokes(STROKES, scene.tool, setting.canvas_m, np.random.default_rng(_SEED))
    start.keep_within(scene.tool, setting.canvas_m, config.edge_m)

    def unguided() -> None:
        strokes = start.pick(slice(None))
        optimise(
            strokes, paper, scene, config, iterations=_TIMED_ITERATIONS, free_color=True, rate=1.0, log=no_log
        )  # fmt: skip

    def guided() -> None:
        descend_guided(start.pick(slice(None)), paper, scene, config=config, guidance=guidance)

    in_turns([unguided, guided], 1)  # compiles
    times = in_turns([unguided, guided], _ROUNDS)
    return {name: t.minimum_s / _TIMED_ITERATIONS for name, t in zip(("print", "guided"), times, strict=True)}


def measure_workers() -> dict[str, float]:
    """Seconds of a painting when one worker makes several, and when two share them: ``one_s``, ``two_s``."""
    with worker_pool(1, _warm) as one, worker_pool(2, _warm) as two:
        _warm()
        _until_both_are_there(two)
        times = in_turns([partial(_paint_all, one), partial(_paint_all, two)], _PAINTING_ROUNDS)
    return {name: t.minimum_s / _PAINTINGS for name, t in zip(("one_s", "two_s"), times, strict=True)}


def sized(side_px: int) -> Setting:
    """The setting of params.yaml on as many pixels a side, however many metres they are."""
    setting = _setting()
    return replace(setting, planner=replace(setting.planner, pixels_per_m=side_px / setting.canvas_m[0]))


def bars(measured: dict[str, Any]) -> list[Bar]:
    """Rows of the section's first table."""
    found = []
    for what, key, bar in (("print objective", "print", 100), ("with semantic guidance", "guided", 20)):
        times = FRIDA_ITERATION_S / measured["iteration"][key]
        found.append(
            Bar(f"paintings an hour over FRIDA's renderer, {what}", f"≥ {bar} ×", f"{times:.0f} ×", times >= bar)
        )
    two = measured["workers"]["one_s"] / measured["workers"]["two_s"]
    enough = measured["cores"] >= 2
    return [
        *found,
        Bar("whole paintings an hour, two workers over one", "≥ 1.8 ×", f"{two:.2f} ×", two >= 1.8 if enough else None),
    ]


def section(measured: dict[str, Any]) -> str:
    """The section in Markdown: what it is about, bars, figures."""
    iteration, workers = measured["iteration"], measured["workers"]
    rows = [
        _iteration_row("FRIDA, renderer alone", FRIDA_ITERATION_S),
        _iteration_row("ours, print objective", iteration["print"]),
        _iteration_row("ours, guided", iteration["guided"]),
    ]
    whole = [
        (f"{name} on {measured['cores']} cores", f"{workers[key]:.2f}", f"{3600 / workers[key]:.0f}")
        for name, key in (("one worker", "one_s"), ("two workers", "two_s"))
    ]
    parts = [
        "## Synthesis of co-paintings",
        _ABOUT.format(
            strokes=STROKES, side=SIDE_PX, views=VIEWS, frida=FRIDA_S, frida_strokes=FRIDA_STROKES, where=WHERE,
            iteration=FRIDA_ITERATION_S, iterations=ITERATIONS, setting=SETTING,
        ),
        bar_table(bars(measured)),
        markdown(("", "s an iteration", f"paintings of {ITERATIONS} iterations an hour", "over FRIDA"), rows),
        markdown(("whole paintings", "s a painting", "an hour"), whole),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _iteration_row(name: str, seconds: float) -> Sequence[str]:
    return (
        name, f"{seconds:.4f}", f"{3600 / (ITERATIONS * seconds):.1f}", f"{FRIDA_ITERATION_S / seconds:.0f} ×",
    )  # fmt: skip


def _setting() -> Setting:
    return load_section(PARAMS, "synthesize_copaintings", SynthesizeCopaintings).settings[SETTING]


def _guidance(setting: Setting) -> Guidance:
    if setting.guidance is None:
        raise ValueError(f"params.yaml: the setting {SETTING} has no guidance; this benchmark measures what it costs.")
    return setting.guidance


def _model() -> StrokeModel:
    return StrokeModel(MODEL, (BristleLag(torch.tensor([LAG_M]), {}),), {}, StrokeTiming(3.0, 9.0))


def _encoder() -> Encoder:
    """Of params.yaml's shape, untrained: what it sees costs what it costs."""
    config = load_section(PARAMS, "train_semantics", TrainSemantics)
    captions = sorted(set(example_table(40)["caption"].to_pylist()))
    tokenizer = learn_tokenizer(captions, config.merges, config.caption_tokens)
    return Encoder(new_model(config.encoders["main"].shape, tokenizer, 0), tokenizer)


@cache
def _painter() -> Painter:
    setting, encoder = _setting(), _encoder()
    return Painter(SETTING, setting, load_tool(setting.tool), _model(), encoder, encoder.digest)


def _paint(seed: int) -> int:
    """Plan one painting; the process that did."""
    with threadpool_limits(1):
        plan_painting(_painter(), load_photograph(_PICTURE), seed)
    return os.getpid()


def _paint_all(submit: Submit) -> None:
    gather([submit(_paint, seed) for seed in range(_PAINTINGS)])


def _warm() -> None:
    cv2.setNumThreads(1)
    _paint(0)


def _until_both_are_there(submit: Submit) -> None:
    seen: set[int] = set()
    while len(seen) < 2:
        jobs: list[Future[int]] = [submit(_who) for _ in range(2)]
        seen = set(gather(jobs))


def _who() -> int:
    time.sleep(0.2)  # long enough for the other one to take the other job
    return os.getpid()


if __name__ == "__main__":
    print(section(measure_synthesis()))
