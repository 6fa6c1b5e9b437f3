"""Ask the goal planners for completions of begun drawings and measure what becomes of them (thesis 6.5 to 6.8)."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pentimento.contracts import copaintings, scenes
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png, write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import read_table
from pentimento.copainting.evaluation.answers import (
    BASE,
    FINE_TUNED,
    NO_CHANGE,
    ON_CANVAS,
    TEXT_ONLY,
    Answers,
    Asking,
    Planners,
    Strokes,
    Task,
    TextOnly,
    answer_on_canvas,
    answer_on_paper,
    ask,
)
from pentimento.copainting.evaluation.cases import choose_cases
from pentimento.copainting.evaluation.codraw import Codrawing, Story, Turn, codraw, stories
from pentimento.copainting.evaluation.goal_plans import Easel, Medium, load_easel, seen
from pentimento.copainting.evaluation.measures import as_tensor, changed_share, delta_pix, delta_sem, surviving_ink
from pentimento.copainting.evaluation.preference_page import Comparison, preference_page
from pentimento.copainting.evaluation.scoring import Columns, Judges, comparisons, correlations, score, summary
from pentimento.copainting.evaluation.sheets import side_by_side
from pentimento.copainting.goal.planner import GoalPlanner, load_goal_planner
from pentimento.copainting.goal.vae import round_trip
from pentimento.copainting.scenes.edits import scenes_of
from pentimento.copainting.scenes.ink import ink_recall
from pentimento.copainting.workers import worker_pool
from pentimento.planning.painter import as_linear
from pentimento.robots.driver import Robot
from pentimento.robots.virtual import VirtualRobot
from pentimento.runner.safety import GuardedRobot, envelope_for
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import clip_score
from pentimento.studio.studio import Studio
from pentimento.studio.world import load_world
from pipelines._config import entry_of, load_section
from pipelines._io import end_with_parent, output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run

Pictures = NDArray[np.uint8]

_SHOWN_PX = 128


@dataclass(frozen=True)
class Shown:
    """What people see."""

    rows: int
    """In the picture of all methods."""
    preferences: int
    """Prompts on the page of blind comparisons; each is compared with every rival."""

    def __post_init__(self) -> None:
        at_least(self, 1, "rows", "preferences")


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
    on_paper: int
    """Of them, those also asked on blank paper."""
    other_medium: int
    """Of them, those also asked on canvases that were begun with another medium (thesis 6.6.4)."""
    strokes: Strokes
    asking: Asking
    text_only: TextOnly
    codrawing: Codrawing
    shown: Shown
    workers: int
    """Processes; any number gives the same results."""
    seed: int
    settings: dict[str, EvaluatedSetting]
    begun_with: dict[str, Medium]
    """For each setting the other medium; on a sheet of the same size and resolution."""

    def __post_init__(self) -> None:
        at_least(self, 2, "prompts")
        at_least(self, 1, "workers", "on_paper", "other_medium")
        at_least(self, 0, "seed")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: metrics.json, cases.json, pictures, the turns, and the page of blind comparisons with its key."""
    config = load_section(Path("params.yaml"), "evaluate_copainting", EvaluateCopainting)
    setting = entry_of(config.settings, arguments.setting, "evaluate_copainting.settings")
    other = entry_of(config.begun_with, arguments.setting, "evaluate_copainting.begun_with")
    for medium in (setting.medium, other):
        if medium.tool not in arguments.tools:
            raise ConfigError(
                f"params.yaml: evaluate_copainting uses the {medium.tool}, but dvc.yaml hands the stage models of "
                f"{', '.join(arguments.tools)} only: choose one of them, or hand it that model, too."
            )
    single_threaded()
    strokes_models = {tool: arguments.models / f"stroke_{tool}" / "weights" for tool in arguments.tools}
    inputs = {
        "scenes": arguments.scenes, "copaintings": arguments.copaintings, "base": arguments.base,
        "fine_tuned": arguments.fine_tuned, "semantics": arguments.semantics, "judge": arguments.judge,
    } | {f"stroke_{tool}": path for tool, path in strokes_models.items()}  # fmt: skip
    params = asdict(replace(config, settings={arguments.setting: setting}, begun_with={arguments.setting: other}))
    with (
        tracked_run("evaluate_copainting", arguments.setting, params, inputs) as run,
        output_folder(arguments.out) as out,
        worker_pool(config.workers, end_with_parent) as submit,
    ):
        held_out = scenes_of(read_table(arguments.scenes, scenes.CONTRACT).table, "test")
        pairs = read_table(arguments.copaintings, copaintings.CONTRACT).table
        cases = choose_cases(held_out, config.prompts, config.seed)
        easel = load_easel(setting.medium, strokes_models[setting.medium.tool])
        task = Task(
            easel, easel, blank_sheet(pairs, cases[0].image.shape), Planners(arguments.base, arguments.fine_tuned),
            arguments.semantics, config.strokes, config.asking, config.text_only, config.seed,
        )  # fmt: skip
        judges = Judges(Encoder.load(arguments.semantics), Encoder.load(arguments.judge), _kinds(held_out))
        captions, asked = [case.caption for case in cases], [case.objects for case in cases]
        present = [case.other_objects for case in cases]

        begun = answer_on_canvas(cases, task, ON_CANVAS, submit)
        table = score(begun, captions, asked, present, judges)
        run.log("prompts", len(cases))
        paper = answer_on_paper(cases[: config.on_paper], task, submit)
        few = len(paper.canvases)
        on_paper = score(paper, captions[:few], asked[:few], [()] * few, judges)
        foreign = answer_on_canvas(
            cases[: config.other_medium],
            replace(task, begun_with=load_easel(other, strokes_models[other.tool])),
            (BASE, FINE_TUNED),
            submit,
        )
        few = len(foreign.canvases)
        on_foreign = score(foreign, captions[:few], asked[:few], present[:few], judges)
        planners = {BASE: load_goal_planner(arguments.base), FINE_TUNED: load_goal_planner(arguments.fine_tuned)}
        told = stories(held_out, config.codrawing.stories)
        turns = {
            name: [_play(planner, story, easel, setting.world, config, number) for number, story in enumerate(told)]
            for name, planner in planners.items()
        }
        metrics = {
            "table": _plain(summary(table, config.seed)),
            "comparisons": _plain(comparisons(table, config.seed)),
            "on_paper": _plain(summary(on_paper, config.seed)),
            "other_medium": _plain(summary(on_foreign, config.seed)),
            "turns": {name: _turn_scores(played, judges) for name, played in turns.items()},
            "correlation": _correlation(pairs, read_table(arguments.scenes, scenes.CONTRACT).table, judges.main),
            "vae_ink_recall": {
                name: _known(ink_recall(begun.canvases, round_trip(planner.vae, begun.canvases)))
                for name, planner in planners.items()
            },
            "cases": {"prompts": len(cases), "on_paper": len(paper.canvases), "other_medium": len(foreign.canvases)},
        }
        write_json(out / "metrics.json", metrics)
        write_json(out / "cases.json", _by_case(captions, [case.scene_id for case in cases], table))
        _draw_sheets(out, captions, begun, paper, foreign, turns, config.shown.rows)
        page, key = preference_page(_compared(captions, begun, config.shown.preferences), config.seed)
        (out / "preference.html").write_text(page, encoding="utf-8")
        write_json(out / "preference_key.json", key)
        run.log_metrics({name: metrics[name] for name in ("table", "comparisons", "on_paper", "vae_ink_recall")})
        for picture in ("methods.png", "turns.png"):
            run.log_picture(out / picture)


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


def _play(
    planner: GoalPlanner, story: Story, easel: Easel, world: str, config: EvaluateCopainting, number: int
) -> list[Turn]:
    """One story on a new sheet in the studio, the robot's goals by this planner."""

    def goal_for(photo: Pictures, prompt: str) -> Pictures:
        return ask(planner, photo[None], [prompt], config.asking)[0]

    seed = config.seed + number
    return codraw(_robot(easel, world, seed), easel, story, goal_for, config.codrawing, seed)


def _robot(easel: Easel, world: str, seed: int) -> Robot:
    """A robot before a blank sheet of the medium's size."""
    known = load_world(world)
    side = easel.medium.side_m
    studio = Studio(replace(known, paper=replace(known.paper, size_m=(side, side))), seed)
    robot = VirtualRobot(studio)
    return GuardedRobot(robot, envelope_for(easel.tool, robot.canvas_size_m))


def _kinds(table: pa.Table) -> tuple[str, ...]:
    """All kinds of objects that scenes name; empty where they name none."""
    if "objects" not in table.column_names:
        return ()
    return tuple(sorted({str(kind) for kinds in table["objects"].to_pylist() for kind in kinds or ()}))


def _plain(estimates: Mapping[str, Any]) -> dict[str, Any]:
    """Estimates as mappings, nested or not."""
    return {name: _plain(value) if isinstance(value, Mapping) else asdict(value) for name, value in estimates.items()}


def _known(value: float) -> float | None:
    """None where there is no such number: canvases without ink have none that could survive."""
    return value if np.isfinite(value) else None


def _correlation(pairs: pa.Table, all_scenes: pa.Table, main: Encoder) -> dict[str, dict[str, float]]:
    """How the gap between a scene and its full painting goes with the painting's score (thesis 6.8.2)."""
    pictures = {row["scene_id"]: row["image"]["bytes"] for row in all_scenes.select(["scene_id", "image"]).to_pylist()}
    rows = {row["scene_id"]: row for row in pairs.select(["scene_id", "full", "caption"]).to_pylist()}
    known = [row for name, row in sorted(rows.items()) if name in pictures]
    if not known:
        return {}
    painted = np.stack([decode_png(row["full"]["bytes"]) for row in known])
    shown = np.stack([decode_png(pictures[row["scene_id"]]) for row in known])
    scores = clip_score(main, as_tensor(painted), [row["caption"] for row in known]).double().numpy()
    return correlations(
        {"delta_pix": delta_pix(shown, painted), "delta_sem": delta_sem(main, shown, painted)}, scores
    )  # fmt: skip


def _turn_scores(played: Sequence[Sequence[Turn]], judges: Judges) -> list[dict[str, float | None]]:
    """For each turn, over stories: the judge's score before and after the robot, and what it changed and kept."""
    return [_of_turn([story[number] for story in played], judges) for number in range(len(played[0]))]


def _of_turn(turns: Sequence[Turn], judges: Judges) -> dict[str, float | None]:
    side = turns[0].goal.shape[0]
    before, after = (_shrunk([getattr(turn, name) for turn in turns], side) for name in ("begun", "after"))
    goals, prompts = np.stack([turn.goal for turn in turns]), [turn.prompt for turn in turns]

    def mean(values: Any) -> float | None:
        known = np.asarray(values, dtype=np.float64)
        known = known[np.isfinite(known)]
        return float(known.mean()) if len(known) else None

    return {
        "judge_score_no_change": mean(clip_score(judges.judge, as_tensor(before), prompts)),
        "judge_score": mean(clip_score(judges.judge, as_tensor(after), prompts)),
        "goal_keeps": mean(surviving_ink(before, goals)),
        "drawing_keeps": mean(surviving_ink(before, after)),
        "changed": mean(changed_share(before, after)),
        "strokes": mean([turn.strokes[1] for turn in turns]),
    }


def _shrunk(photos: Sequence[Pictures], side: int) -> Pictures:
    return np.stack([seen(as_linear(photo), side) for photo in photos])


def _by_case(captions: Sequence[str], ids: Sequence[str], table: Mapping[str, Columns]) -> list[dict[str, Any]]:
    """Each prompt with all its numbers; null where a number does not exist."""
    return [
        {"scene_id": ids[i], "caption": caption}
        | {
            method: {name: float(v[i]) if np.isfinite(v[i]) else None for name, v in columns.items()}
            for method, columns in table.items()
        }
        for i, caption in enumerate(captions)
    ]


def _draw_sheets(
    out: Path,
    captions: Sequence[str],
    begun: Answers,
    paper: Answers,
    foreign: Answers,
    turns: Mapping[str, Sequence[Sequence[Turn]]],
    rows: int,
) -> None:
    """methods.png, on_paper.png, other_medium.png; turns.png, the first story as a film strip (fine-tuned)."""
    for name, answers in (("methods", begun), ("on_paper", paper), ("other_medium", foreign)):
        columns: dict[str, Pictures] = {"canvas": answers.canvases}
        for method, drawings in answers.drawings.items():
            if method in answers.goals:
                columns[f"{method}: goal"] = answers.goals[method]
            if method != NO_CHANGE:
                columns[f"{method}: plan"] = drawings
        count = min(rows, len(answers.canvases))
        write_png(out / f"{name}.png", side_by_side(columns, captions[:count], _SHOWN_PX))
    for name, played in turns.items():
        story = played[0]
        strip = {
            "person draws": [turn.begun for turn in story],
            "goal": [turn.goal for turn in story],
            "plan": [turn.foretold for turn in story],
            "robot adds": [turn.after for turn in story],
        }
        file = "turns.png" if name == FINE_TUNED else f"turns_{name}.png"
        write_png(out / file, side_by_side(strip, [turn.prompt for turn in story], 2 * _SHOWN_PX))


def _compared(captions: Sequence[str], answers: Answers, count: int) -> list[Comparison]:
    """Ours against each rival of the thesis's survey, for the first prompts."""
    ours = answers.drawings[FINE_TUNED]
    return [
        Comparison(captions[i], ours[i], answers.drawings[rival][i], rival)
        for i in range(min(count, len(ours)))
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
