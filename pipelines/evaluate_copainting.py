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

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts import copaintings, scenes
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import decode_png, write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import read_table
from pentimento.copainting.drawings.pairs import drawn_pairs
from pentimento.copainting.drawings.scenes import Medium as DrawingMedium
from pentimento.copainting.drawings.sources import nouns_of
from pentimento.copainting.evaluation.cases import Case, begun_by_others, choose_cases, composed_cases, paper_cases
from pentimento.copainting.evaluation.codraw import Codrawing, Story, Turn, film_strip, stories, turn_scores, wishes
from pentimento.copainting.evaluation.goal_plans import Medium, load_paint_context
from pentimento.copainting.evaluation.methods import (
    BASE,
    FINE_TUNED,
    ON_CANVAS,
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
from pentimento.copainting.evaluation.preferences import Comparison, preference_page
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
from pentimento.copainting.scenes.collage import as_drawn, shows_named_things
from pentimento.copainting.scenes.edits import Pair, scene_edits, scenes_of
from pentimento.copainting.scenes.ink import ink_recall
from pentimento.copainting.sheets import side_by_side
from pentimento.deploy.words import taught_vocabulary
from pentimento.robots.tools import load_tool
from pentimento.semantics.encoder import Encoder
from pipelines._config import entry_of, load_section, require_model
from pipelines._io import end_with_parent, output_folder, single_threaded, stage_main, write_json
from pipelines._play import play
from pipelines._tracking import tracked_run

Pictures = NDArray[np.uint8]

BEGUN = "begun"
"""Requests on canvases that somebody else began: the thesis's Table 6.1."""
_SHOWN_PX = 128
_TURNS = 3  # of a story whose things a person begins to draw


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
class EvaluatedSetting:
    """What the robot draws with in one setting, and where."""

    world: str
    """The studio's, in which person and robot draw in turns."""
    medium: Medium


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
        at_least(self, 1, "workers", "blank_canvas_prompts", "ordinary_scenes", "other_medium_prompts")
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
        table, asked = _asked(arguments.scenes, setting.medium, config)
        pairs = read_table(arguments.copaintings, copaintings.CONTRACT).table
        begun = asked.on_canvas[BEGUN]
        paint_context = load_paint_context(setting.medium, strokes_models[setting.medium.tool])
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
            play, world=setting.world, sampling=config.sampling, codrawing=config.codrawing,
            vocabulary=asked.vocabulary,
        )  # fmt: skip
        played = {
            name: [
                submit(partial(story_of, seed=seed), folder, story, paint_context)
                for seed, story in enumerate(asked.stories, config.seed)
            ]
            for name, folder in ((BASE, planners.base), (FINE_TUNED, planners.fine_tuned))
        }
        drawn = {
            name: run_on_canvas(cases, task, ON_CANVAS if name == BEGUN else (BASE, FINE_TUNED), submit)
            for name, cases in asked.on_canvas.items()
        }
        drawn |= {name: run_on_paper(cases, task, submit) for name, cases in asked.on_paper.items()}
        few = begun[: config.other_medium_prompts]
        other_task = replace(task, begun_with=load_paint_context(other, strokes_models[other.tool]))
        drawn["other_medium"] = run_on_canvas(few, other_task, (BASE, FINE_TUNED), submit)
        given = {**asked.on_canvas, **asked.on_paper, "other_medium": few}
        turns = {name: gather(futures) for name, futures in played.items()}

        scores = {name: score(outcomes, given[name], judges) for name, outcomes in drawn.items()}
        metrics = {
            **{name: _plain(summary(of_one, config.seed)) for name, of_one in scores.items()},
            "comparisons": _plain(comparisons(scores[BEGUN], config.seed)),
            "ordinary": _plain(ordinary.result()),
            "turns": {
                name: turn_scores(of_one, asked.stories, judges.judge, judges.kinds) for name, of_one in turns.items()
            },
            "correlation": painted_gap(pairs, table, judges.main),
            "vae_ink_recall": _ink_recall(drawn[BEGUN].canvases, planners),
            "cases": {name: len(cases) for name, cases in given.items()} | {"ordinary": len(asked.edits)},
        }
        write_json(out / "metrics.json", metrics)
        write_json(out / "cases.json", _by_case(begun, scores[BEGUN]))
        _write_pictures(out, {name: (drawn[name], given[name]) for name in given}, turns, config.figures.method_rows)
        page, key = preference_page(_compared(begun[: config.figures.preference_prompts], drawn[BEGUN]), config.seed)
        (out / "preference.html").write_text(page, encoding="utf-8")
        write_json(out / "preference_key.json", key)
        run.log_metrics(
            {name: metrics[name] for name in (BEGUN, "comparisons", "ordinary", "on_paper", "vae_ink_recall")}
        )
        for picture in (f"{BEGUN}.png", "turns.png"):
            run.log_picture(out / picture)


@dataclass(frozen=True, eq=False)
class _Asked:
    """What the goal planners are asked for."""

    on_canvas: dict[str, list[Case]]
    on_paper: dict[str, list[Case]]
    edits: list[Pair]
    stories: list[Story]
    kinds: tuple[str, ...]
    """Which the judge ranks."""
    vocabulary: Vocabulary | None
    """What the planners were taught; None if they know all words."""


def _asked(folder: Path, medium: Medium, config: EvaluateCopainting) -> tuple[pa.Table, _Asked]:
    """The scenes as the medium's tool draws them, and held-out requests: for named things, or from the scenes."""
    has_ink = load_tool(medium.tool).color_srgb is not None
    table = as_drawn(read_table(folder, scenes.CONTRACT).table, with_pen=has_ink and medium.ink is None)
    held_out = scenes_of(table, "test")
    paper = paper_cases(held_out, config.blank_canvas_prompts)
    if not shows_named_things(table):
        begun = choose_cases(held_out, scenes_of(table, "train"), config.prompts, config.seed)
        edits = scene_edits(held_out.slice(0, config.ordinary_scenes), 1, config.seed)
        told = stories(held_out, config.codrawing.stories, _TURNS)
        return table, _Asked({BEGUN: begun}, {"on_paper": paper}, edits, told, _kinds(held_out), None)
    side, nouns = paper[0].image.shape[0], nouns_of("openmoji")
    drawn_with: DrawingMedium = "marker" if has_ink else "colour"
    on_canvas = {
        name: begun_by_others(config.prompts, drawn_with, side_px=side, overlapping=over, seed=config.seed)
        for name, over in ((BEGUN, False), ("overlapping", True))
    }
    on_paper = {
        f"composed_{name}": composed_cases(
            config.blank_canvas_prompts, split, drawn_with, side_px=side, seed=config.seed
        )
        for name, split in (("seen", "train"), ("held_out", "test"))
    }
    edits = drawn_pairs(config.ordinary_scenes, "test", nouns, blank_share=0.3, side_px=side, seed=config.seed)
    told = wishes(config.codrawing.stories, turns=config.codrawing.wishes, side_px=side, seed=config.seed)
    return table, _Asked(on_canvas, {"on_paper": paper, **on_paper}, edits, told, nouns, taught_vocabulary("named"))


def _write_pictures(
    out: Path,
    asked: Mapping[str, tuple[Outcomes, Sequence[Case]]],
    turns: Mapping[str, Sequence[Sequence[Turn]]],
    rows: int,
) -> None:
    """Write a picture of all methods for each set of prompts, and a film strip of each planner's first story."""
    for name, (outcomes, cases) in asked.items():
        captions = [case.caption for case in cases[:rows]]
        write_png(out / f"{name}.png", side_by_side(outcome_columns(outcomes), captions, (_SHOWN_PX, _SHOWN_PX)))
    for name, drawn in turns.items():
        file = "turns.png" if name == FINE_TUNED else f"turns_{name}.png"
        prompts = [turn.prompt for turn in drawn[0]]
        write_png(out / file, side_by_side(film_strip(drawn[0]), prompts, (2 * _SHOWN_PX, 2 * _SHOWN_PX)))


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


def _kinds(table: pa.Table) -> tuple[str, ...]:
    """All kinds of objects that scenes name; empty where they name none."""
    if "objects" not in table.column_names:
        return ()
    return tuple(sorted({str(kind) for kinds in table["objects"].to_pylist() for kind in kinds or ()}))


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


def _compared(cases: Sequence[Case], outcomes: Outcomes) -> list[Comparison]:
    """Ours against each rival of the thesis's survey."""
    ours = outcomes.drawings[FINE_TUNED]
    return [
        Comparison(case.caption, ours[i], outcomes.drawings[rival][i], rival)
        for i, case in enumerate(cases)
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
