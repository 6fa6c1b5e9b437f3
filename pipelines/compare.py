"""Compare two runs, or two executions of the pipeline: the changes, the better side, and whether it is luck.

python -m pipelines.compare RUN_A RUN_B       ids, their first letters, or an execution's name
python -m pipelines.compare --last 2          the last two executions of one profile
python -m pipelines.compare --last 2 --stage train_stroke_dynamics@marker
python -m pipelines.compare --seeds           the last two groups of `make repro SEEDS=5 STAGE=…`
python -m pipelines.compare --check           do MLflow and dvc.lock agree?
python -m pipelines.compare --metrics FILE    every metric of the last execution, or of a RUN, as a CSV file
"""

import argparse
import csv
import io
import os
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import PentimentoError
from pipelines._io import stage_main
from pipelines._review.agreement import altered, check
from pipelines._review.comparison import compare
from pipelines._review.group_page import group_page
from pipelines._review.groups import Group, compare_groups, groups, table
from pipelines._review.history import Execution, History, StageRun
from pipelines._review.page import changes, page, text
from pipelines._side_by_side import items_of
from pipelines._tracking.dvc_files import locked_stages
from pipelines._tracking.store import store_errors
from pipelines._tracking.timings import COMPARISONS


def main(arguments: argparse.Namespace) -> None:
    """Print the comparison and write its page; or check that MLflow and DVC agree."""
    if arguments.check:
        _check(arguments.profile, arguments.stage)
        return
    os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")  # a line for each picture
    with store_errors():
        history = History()
        if arguments.metrics is not None:
            _write_metrics(history, arguments.runs, arguments.metrics)
            return
        if two := _chosen_groups(history, arguments):
            file, words = _of_groups(history, *two, arguments.out)
            print(f"{words}\n\nThe page:  {file}")
            return
        a, b = _chosen(history, arguments)
        comparison = compare(history, a, b)
    arguments.out.mkdir(parents=True, exist_ok=True)
    file = arguments.out / f"{_id(a)[:8]}_{_id(b)[:8]}.html"
    atomic_write(file, page(comparison).encode())
    print(text(comparison))
    print(f"\nThe page:  {file}")


def _write_metrics(history: History, named: Sequence[str], file: Path) -> None:
    """Write stage, run, metric and value of each figure of one run or execution; without a name, of the last one."""
    if len(named) > 1:
        raise PentimentoError(f"--metrics writes one run or execution, and the command names {len(named)}.")
    if not named and not history.executions:
        raise PentimentoError("MLflow's store has no execution; run `make repro`, or name a run.")
    of = history.find(named[0]) if named else history.executions[0]
    runs = [of] if isinstance(of, StageRun) else list(history.of_execution(of).values())
    rows = [(run.name, run.id, metric, value) for run in runs for metric, value in sorted(run.metrics.items())]
    text_of_table = io.StringIO()
    csv.writer(text_of_table, lineterminator="\n").writerows([("stage", "run", "metric", "value"), *rows])
    file.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(file, text_of_table.getvalue().encode())
    print(f"{len(rows)} metrics of {len(runs)} stage runs are in {file}.")


def _chosen_groups(history: History, arguments: argparse.Namespace) -> tuple[Group, Group] | None:
    """Return the two groups of seeds that the command names, the older one first; None where it names no groups."""
    known = groups(history)
    named = [group for reference in arguments.runs for group in known if group.name == reference]
    if not arguments.seeds:
        return (named[0], named[1]) if len(named) == 2 else None
    if arguments.stage is not None:
        _require_known(arguments.stage, history)
        known = [group for group in known if group.stage == arguments.stage]
    if known:
        known = [group for group in known if (group.stage, group.profile) == (known[0].stage, known[0].profile)]
    if len(known) < 2:
        raise PentimentoError(
            f"Two groups of one stage and profile are compared and MLflow's store has {len(known)}; "
            "make one with `make repro SEEDS=5 STAGE=<stage>` before a change and one after it."
        )
    return known[1], known[0]


def _of_groups(history: History, a: Group, b: Group, out: Path) -> tuple[Path, str]:
    """Write the page of two groups, and return its file, and what differs with the table of their figures."""
    figures, first = compare_groups(history, a, b), min(set(a.members) & set(b.members))
    differing = changes(compare(history, a.members[first], b.members[first]))
    main = [figure for figure in figures if figure.main]
    verdicts = [f"{figure.stage}: {figure.verdict} ({figure.name})." for figure in main]
    out.mkdir(parents=True, exist_ok=True)
    file = out / f"{_id(a.members[first])[:8]}_{_id(b.members[first])[:8]}_seeds.html"
    atomic_write(file, group_page(history, a, b, found=figures, changes=differing).encode())
    return file, "\n".join([f"A  {a.name}", f"B  {b.name}", "", *differing, "", *verdicts, "", table(figures)])


def _chosen(history: History, arguments: argparse.Namespace) -> tuple[StageRun | Execution, StageRun | Execution]:
    """Return the two sides that the command names; of the last two, the older one first."""
    if arguments.last is None:
        if len(arguments.runs) != 2:
            raise PentimentoError(
                f"Two runs are compared and the command names {len(arguments.runs)}; name two, or use --last 2."
            )
        first, second = (history.find(reference) for reference in arguments.runs)
        return first, second
    if arguments.runs or arguments.last != 2:
        raise PentimentoError("--last takes the number 2 and no other runs beside it.")
    known: list[StageRun | Execution] = [
        each for each in history.executions if each.status != "RUNNING" and "group" not in each.tags
    ]
    kind = "executions that ended"
    if arguments.stage is not None:
        known = [
            run
            for run in history.runs
            if arguments.stage in (run.name, run.stage) and run.status == "FINISHED" and "group" not in run.tags
        ]
        kind = f"finished runs of {arguments.stage}"
        _require_known(arguments.stage, history)
    if len(known) < 2:
        raise PentimentoError(f"Two {kind} are compared and MLflow's store has {len(known)}; run once more.")
    return last_two(known)


def _require_known(stage: str, history: History) -> None:
    """Raise an error that lists what is close, where MLflow's store has no run of a stage or stage@item."""
    stages, names = {run.stage for run in history.runs}, {run.name for run in history.runs}
    if stage in stages | names:
        return
    items = sorted(name for name in names if name.partition("@")[0] == stage.partition("@")[0])
    near = items or get_close_matches(stage, stages | names) or sorted(stages)
    raise PentimentoError(
        f"MLflow's store has no run of {stage!r}; it has runs of {', '.join(near) or 'no stage: run `make repro`'}."
    )


def last_two(known: Sequence[StageRun | Execution]) -> tuple[StageRun | Execution, StageRun | Execution]:
    """Return the newest and the one before it, of its profile if there is one; `known` is sorted newest first."""
    newest, *earlier = known
    same_profile = [each for each in earlier if each.tags.get("profile") == newest.tags.get("profile")]
    return (same_profile or earlier)[0], newest


def _check(profile: str, stage: str | None) -> None:
    folder = Path.cwd() if profile == "default" else Path(".profiles") / profile
    if not locked_stages(folder):
        sentence = f"{folder} has no dvc.lock with stages: `make repro` has not run there."
        raise PentimentoError(" ".join([sentence, *_newest_profile(other_than=profile)]))
    if stage is not None:
        items_of(stage, folder)  # an error where there is no such stage
    agreeing, differences = check(folder, profile, stage)
    files = [each for name, each in altered(folder).items() if stage in (None, name, name.partition("@")[0])]
    for sentence in [*differences, *files]:
        print(sentence)
    found = []
    if differences:
        found.append(
            f"MLflow and dvc.lock disagree on {len(differences)} of {len(agreeing) + len(differences)} stage items."
        )
        found += _newest_profile(other_than=profile)
    if files:
        found.append(f"Files of {len(files)} of the stage items are not those of dvc.lock; `make repro` restores them.")
    if found:
        raise PentimentoError(" ".join(found))
    if stage is not None:
        for name, run_id in agreeing.items():
            print(f"{name}: written by the run {run_id}, and not changed since.")
    print(f"MLflow and dvc.lock agree on all {len(agreeing)} stage items.")


def _newest_profile(*, other_than: str) -> list[str]:
    """A sentence on the profile of the last execution, where it is another one than was checked."""
    with store_errors():
        newest = next(iter(History().executions), None)
    profile = newest.tags.get("profile", other_than) if newest else other_than
    return [] if profile == other_than else [f"The last execution is of another profile: `--profile {profile}`."]


def _id(of: StageRun | Execution) -> str:
    return of.id if isinstance(of, StageRun) else of.ids[0]


def command_line() -> argparse.ArgumentParser:
    """The options of ``main``."""
    parser = argparse.ArgumentParser(
        prog="compare", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="*", metavar="RUN")
    parser.add_argument(
        "--last", type=int, metavar="2", help="the last two executions, or runs of --stage, of one profile"
    )
    parser.add_argument("--stage", help="a stage, or stage@item; with --check, the only one that is checked")
    parser.add_argument("--seeds", action="store_true", help="the last two groups of seeds, of --stage if it is given")
    parser.add_argument("--check", action="store_true", help="compare dvc.lock with MLflow, and files with both")
    parser.add_argument("--metrics", type=Path, metavar="FILE", help="write every metric of one side as CSV instead")
    parser.add_argument("--profile", default="default", help="of --check: whose dvc.lock")
    parser.add_argument("--out", type=Path, default=COMPARISONS, help="folder for the page")
    return parser


if __name__ == "__main__":
    stage_main(main, command_line())
