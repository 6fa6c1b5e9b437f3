"""Evaluate completions of begun drawings by the goal planners (thesis 6.5 to 6.8)."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png, write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.statistics import item_resamples, mean_estimate
from pentimento.contracts.tables import read_table
from pentimento.copainting.evaluation.cases import Case
from pentimento.copainting.evaluation.codraw import (
    Codrawing,
    Turn,
    executed_found,
    film_strip,
    one_turn_each,
    turn_scores,
)
from pentimento.copainting.evaluation.exam import BEGUN, ExamSize, exam_from
from pentimento.copainting.evaluation.goal_plans import Medium, load_paint_context
from pentimento.copainting.evaluation.methods import (
    BASE,
    FINE_TUNED,
    ON_CANVAS,
    ORACLE,
    TEXT_ONLY,
    Outcomes,
    Planners,
    Strokes,
    Task,
    TextOnly,
    outcome_columns,
    run_on_canvas,
    run_on_paper,
)
from pentimento.copainting.evaluation.scoring import (
    Columns,
    Judges,
    comparisons,
    edit_scores,
    painted_gap,
    score,
    summary,
)
from pentimento.copainting.goal.planner import SeededSampling, load_goal_planner
from pentimento.copainting.goal.vae import round_trip
from pentimento.copainting.jobs import gather, worker_pool
from pentimento.copainting.scenes.collage import as_drawn
from pentimento.copainting.scenes.ink import ink_recall
from pentimento.copainting.sheets import side_by_side
from pentimento.rating.page import Trial, pages
from pentimento.rating.study import read_study
from pentimento.semantics.encoder import Encoder
from pipelines._config import entry_of, load_section, require_model
from pipelines._io import end_with_parent, output_folder, single_threaded, stage_main, write_json
from pipelines._play import EvaluatedSetting, play
from pipelines._tracking import tracked_run

Pictures = NDArray[np.uint8]

_SHOWN_PX = 128


@dataclass(frozen=True)
class FigureCounts:
    """How many prompts the pictures and the preference page show."""

    method_rows: int
    """Rows in the picture of all methods."""
    preference_prompts: int
    """Prompts on the page of blind comparisons; each is compared with every other method."""

    def __post_init__(self) -> None:
        at_least(self, 1, "method_rows", "preference_prompts")


@dataclass(frozen=True)
class EvaluateCopainting:
    """Section `evaluate_copainting` of params.yaml."""

    prompts: int
    """Held-out prompts on begun canvases (thesis 6.6.1)."""
    blank_canvas_prompts: int
    """Held-out prompts on blank paper."""
    ordinary_scenes: int
    """Held-out scenes with an object removed; their completion is scored without a robot's drawing."""
    other_medium_prompts: int
    """How many of `prompts` are repeated on canvases that were begun with another medium (thesis 6.6.4)."""
    executed_prompts: int
    """How many of each kind the robot draws in the studio, by the fine-tuned planner."""
    strokes: Strokes
    sampling: SeededSampling
    """Of the goal planner."""
    text_only: TextOnly
    codrawing: Codrawing
    figures: FigureCounts
    workers: int
    """Processes; any number gives the same results."""
    seed: int
    settings: dict[str, EvaluatedSetting]
    other_media: dict[str, Medium]
    """By setting, the other medium, on a sheet of the same size and resolution."""

    def __post_init__(self) -> None:
        at_least(self, 2, "prompts")
        at_least(
            self, 1, "workers", "blank_canvas_prompts", "ordinary_scenes", "other_medium_prompts", "executed_prompts"
        )
        at_least(self, 0, "seed")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: metrics.json, cases.json, pictures, the turns, and the page of blind comparisons with its key."""
    config = load_section(Path("params.yaml"), "evaluate_copainting", EvaluateCopainting)
    setting = entry_of(config.settings, arguments.setting, "evaluate_copainting.settings")
    other = entry_of(config.other_media, arguments.setting, "evaluate_copainting.other_media")
    for place, medium in (("settings", setting.medium), ("other_media", other)):
        require_model(f"evaluate_copainting.{place}.{arguments.setting}: tool", medium.tool, arguments.tools)
    single_threaded()
    strokes_models = {tool: arguments.models / f"stroke_{tool}" / "weights" for tool in arguments.tools}
    inputs = {
        "scenes": arguments.scenes, "copaintings": arguments.copaintings, "base": arguments.base,
        "fine_tuned": arguments.fine_tuned, "semantics": arguments.semantics, "judge": arguments.judge,
    } | {f"stroke_{tool}": path for tool, path in strokes_models.items()}  # fmt: skip
    params = asdict(replace(config, settings={arguments.setting: setting}, other_media={arguments.setting: other}))
    with (
        tracked_run("evaluate_copainting", arguments.setting, params, inputs) as run,
        output_folder(arguments.out) as out,
        worker_pool(config.workers, end_with_parent) as submit,
    ):
        paint_context = load_paint_context(setting.medium, strokes_models[setting.medium.tool])
        has_ink = paint_context.tool.color_srgb is not None
        table = as_drawn(
            read_table(arguments.scenes, scenes.CONTRACT).table, with_pen=has_ink and setting.medium.ink is None
        )
        size = ExamSize(config.prompts, config.blank_canvas_prompts, config.ordinary_scenes)
        asked = exam_from(table, size, config.codrawing, has_ink=has_ink, seed=config.seed)
        pairs = read_table(arguments.copaintings, copaintings.CONTRACT).table
        begun = asked.on_canvas[BEGUN]
        planners = Planners(arguments.base, arguments.fine_tuned)
        task = Task(
            paint_context, paint_context, blank_sheet(pairs, begun[0].image.shape), planners, arguments.semantics,
            asked.vocabulary, config.strokes, config.sampling, config.text_only, config.seed,
        )  # fmt: skip
        judges = Judges(Encoder.load(arguments.semantics), Encoder.load(arguments.judge), asked.kinds)

        ordinary = submit(
            partial(edit_scores, judge=arguments.judge, seed=config.seed), planners.base, asked.edits, config.sampling
        )
        story_of = partial(
            play, world=setting.world, sampling=config.sampling, vocabulary=asked.vocabulary,
        )  # fmt: skip
        played = {
            name: [
                submit(partial(story_of, codrawing=config.codrawing, seed=seed), folder, story, paint_context)
                for seed, story in enumerate(asked.stories, config.seed)
            ]
            for name, folder in ((BASE, planners.base), (FINE_TUNED, planners.fine_tuned))
        }
        once = replace(
            config.codrawing, person_strokes=config.strokes.begun, robot_strokes=config.strokes.added, largest=1.0
        )
        tried = {name: cases[: config.executed_prompts] for name, cases in (asked.on_canvas | asked.on_paper).items()}
        executed = {
            name: [
                submit(partial(story_of, codrawing=once, seed=seed), planners.fine_tuned, story, paint_context)
                for seed, story in enumerate(one_turn_each(cases), config.seed)
            ]
            for name, cases in tried.items()
        }
        drawn = {
            name: run_on_canvas(cases, task, ON_CANVAS if name == BEGUN else (BASE, FINE_TUNED, ORACLE), submit)
            for name, cases in asked.on_canvas.items()
        }
        drawn |= {name: run_on_paper(cases, task, submit) for name, cases in asked.on_paper.items()}
        few = begun[: config.other_medium_prompts]
        other_task = replace(task, begun_with=load_paint_context(other, strokes_models[other.tool]))
        drawn["other_medium"] = run_on_canvas(few, other_task, (BASE, FINE_TUNED), submit)
        given = {**asked.on_canvas, **asked.on_paper, "other_medium": few}
        turns = {name: gather(futures) for name, futures in played.items()}
        photographed = {name: gather(futures) for name, futures in executed.items()}

        scores = {name: score(outcomes, given[name], judges) for name, outcomes in drawn.items()}
        metrics = {
            **{name: _plain(summary(of_one, config.seed)) for name, of_one in scores.items()},
            "comparisons": _plain(comparisons(scores[BEGUN], config.seed)),
            "ordinary": _plain(ordinary.result()),
            "turns": {
                name: turn_scores(of_one, asked.stories, judges.judge, judges.kinds) for name, of_one in turns.items()
            },
            "executed": _executed(photographed, tried, judges, config.seed) if judges.kinds else {},
            "correlation": painted_gap(pairs, table, judges.main),
            "vae_ink_recall": _ink_recall(drawn[BEGUN].canvases, planners),
            "cases": {name: len(cases) for name, cases in given.items()} | {"ordinary": len(asked.edits)},
        }
        write_json(out / "metrics.json", metrics)
        write_json(out / "cases.json", _by_case(begun, scores[BEGUN]))
        _write_pictures(
            out, {name: (drawn[name], given[name]) for name in given}, turns, photographed, config.figures.method_rows
        )
        trials, study = _trials(begun[: config.figures.preference_prompts], drawn[BEGUN]), read_study("text")
        texts, key = pages(study, trials, raters=1, per_rater=None, seed=config.seed)
        (page,) = texts.values()
        (out / "preference.html").write_text(page, encoding="utf-8")
        write_json(out / "preference_key.json", to_plain(key))
        run.log_metrics(
            {name: metrics[name] for name in (BEGUN, "comparisons", "ordinary", "on_paper", "vae_ink_recall")}
        )
        for picture in (f"{BEGUN}.png", "turns.png"):
            run.log_picture(out / picture)


def _write_pictures(
    out: Path,
    asked: Mapping[str, tuple[Outcomes, Sequence[Case]]],
    turns: Mapping[str, Sequence[Sequence[Turn]]],
    photographed: Mapping[str, Sequence[Sequence[Turn]]],
    rows: int,
) -> None:
    """Write a picture of all methods for each set of prompts, a film strip of each planner's first story, and the
    photographs of what was executed.
    """
    for name, (outcomes, cases) in asked.items():
        captions = [case.caption for case in cases[:rows]]
        write_png(out / f"{name}.png", side_by_side(outcome_columns(outcomes), captions, (_SHOWN_PX, _SHOWN_PX)))
    for name, drawn in turns.items():
        file = "turns.png" if name == FINE_TUNED else f"turns_{name}.png"
        prompts = [turn.prompt for turn in drawn[0]]
        write_png(out / file, side_by_side(film_strip(drawn[0]), prompts, (2 * _SHOWN_PX, 2 * _SHOWN_PX)))
    shown = [played[0] for of_kind in photographed.values() for played in of_kind[:rows]]
    prompts = [turn.prompt for turn in shown]
    write_png(out / "executed.png", side_by_side(film_strip(shown), prompts, (2 * _SHOWN_PX, 2 * _SHOWN_PX)))


def _executed(
    photographed: Mapping[str, Sequence[Sequence[Turn]]],
    tried: Mapping[str, Sequence[Case]],
    judges: Judges,
    seed: int,
) -> dict[str, Any]:
    """By kind of request, the fraction of the requested things that the judge finds on the photographs."""
    found = {name: executed_found(played, tried[name], judges) for name, played in photographed.items()}
    estimates = {name: mean_estimate(values, item_resamples(len(values), seed)) for name, values in found.items()}
    return _plain({name: estimate for name, estimate in estimates.items() if estimate is not None})


def blank_sheet(pairs: pa.Table, shape: tuple[int, ...]) -> Pictures:
    """The sheet of paper that the goal planner was trained on: the partial painting without any stroke.

    Raises:
        ContractError: there is none, or it is not of this shape.
    """
    for strategy, partial_ in zip(pairs["strategy"].to_pylist(), pairs["partial"].to_pylist(), strict=True):
        if strategy == "all":
            blank = decode_png(partial_["bytes"])
            if blank.shape != shape:
                raise ContractError(
                    f"The co-paintings are {blank.shape[:2]} px large and the scenes {shape[:2]}: make both one size."
                )
            return blank
    raise ContractError("No co-painting begins on a blank sheet (strategy all); synthesise some that do.")


def _plain(estimates: Mapping[str, Any]) -> dict[str, Any]:
    """Estimates as mappings, nested or not."""
    return {name: _plain(value) if isinstance(value, Mapping) else asdict(value) for name, value in estimates.items()}


def _ink_recall(canvases: Pictures, planners: Planners) -> dict[str, float | None]:
    """Return the fraction of ink that each planner's autoencoder keeps."""
    folders = {BASE: planners.base, FINE_TUNED: planners.fine_tuned}
    autoencoders = {name: load_goal_planner(folder).vae for name, folder in folders.items()}
    return {name: _known(ink_recall(canvases, round_trip(vae, canvases))) for name, vae in autoencoders.items()}


def _known(value: float) -> float | None:
    """None where there is no such number: canvases without ink have none that could survive."""
    return value if np.isfinite(value) else None


def _by_case(cases: Sequence[Case], scores: Mapping[str, Columns]) -> list[dict[str, Any]]:
    """Each prompt with all its numbers; null where a number does not exist."""
    return [
        {"scene_id": case.scene_id, "caption": case.caption}
        | {
            method: {name: float(v[i]) if np.isfinite(v[i]) else None for name, v in columns.items()}
            for method, columns in scores.items()
        }
        for i, case in enumerate(cases)
    ]


def _trials(cases: Sequence[Case], outcomes: Outcomes) -> list[Trial]:
    """Ours against each rival of the thesis's survey (Figure 6.6); one page that anybody may answer."""
    return [
        Trial(
            f"{number} {case.scene_id}",
            {name: outcomes.drawings[name][number] for name in (FINE_TUNED, rival)},
            case.caption,
        )
        for number, case in enumerate(cases)
        for rival in (TEXT_ONLY, BASE)
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="evaluate_copainting", description=__doc__)
    parser.add_argument("--setting", required=True)
    parser.add_argument("--scenes", required=True, type=Path)
    parser.add_argument("--copaintings", required=True, type=Path)
    parser.add_argument("--base", required=True, type=Path, help="goal planner before fine-tuning")
    parser.add_argument("--fine-tuned", required=True, type=Path)
    parser.add_argument("--semantics", required=True, type=Path)
    parser.add_argument("--judge", required=True, type=Path)
    parser.add_argument("--models", required=True, type=Path, help="folder of stroke_<tool>")
    parser.add_argument("--tools", required=True, nargs="+", help="whose models are there")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
