"""Compare two runs, or two executions of the pipeline: the changes, the better side, and whether it is luck.

python -m pipelines.compare RUN_A RUN_B       ids, their first letters, or an execution's name
python -m pipelines.compare --last 2          the last two executions of one profile
python -m pipelines.compare --last 2 --stage train_stroke_dynamics@marker
python -m pipelines.compare --seeds           the last two groups of `make repro SEEDS=5 STAGE=…`
python -m pipelines.compare --check           do MLflow and dvc.lock agree?
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import PentimentoError
from pipelines._io import stage_main
from pipelines._review.agreement import check
from pipelines._review.comparison import compare
from pipelines._review.group_page import group_page
from pipelines._review.groups import Group, compare_groups, groups, table
from pipelines._review.history import Execution, History, StageRun
from pipelines._review.page import changes, page, text
from pipelines._tracking.store import store_errors
from pipelines._tracking.timings import COMPARISONS


def main(arguments: argparse.Namespace) -> None:
    """Print the comparison and write its page; or check that MLflow and DVC agree."""
    if arguments.check:
        _check(arguments.profile)
        return
    os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")  # a line for each picture
    with store_errors():
        history = History()
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


def _chosen_groups(history: History, arguments: argparse.Namespace) -> tuple[Group, Group] | None:
    """Return the two groups of seeds that the command names, the older one first; None where it names no groups."""
    known = groups(history)
    named = [group for reference in arguments.runs for group in known if group.name == reference]
    if not arguments.seeds:
        return (named[0], named[1]) if len(named) == 2 else None
    if arguments.stage is not None:
        known = [group for group in known if group.stage == arguments.stage]
    if known:
        known = [group for group in known if (group.stage, group.profile) == (known[0].stage, known[0].profile)]
    if len(known) < 2:
        raise PentimentoError(
            f"There are {len(known)} groups of one stage and profile in MLflow's store, and two are compared; "
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
                f"{len(arguments.runs)} runs are named and two are compared; name two, or use --last 2."
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
    if len(known) < 2:
        raise PentimentoError(f"There are {len(known)} {kind} in MLflow's store, and two are compared; run once more.")
    return last_two(known)


def last_two(known: Sequence[StageRun | Execution]) -> tuple[StageRun | Execution, StageRun | Execution]:
    """Return the newest and the one before it, of its profile if there is one; `known` is sorted newest first."""
    newest, *earlier = known
    same_profile = [each for each in earlier if each.tags.get("profile") == newest.tags.get("profile")]
    return (same_profile or earlier)[0], newest


def _check(profile: str) -> None:
    folder = Path.cwd() if profile == "default" else Path(".profiles") / profile
    agreeing, differences = check(folder, profile)
    for sentence in differences:
        print(sentence)
    if differences:
        raise PentimentoError(
            f"MLflow and dvc.lock disagree on {len(differences)} of {agreeing + len(differences)} stage items."
        )
    print(f"MLflow and dvc.lock agree on all {agreeing} stage items.")


def _id(of: StageRun | Execution) -> str:
    return of.id if isinstance(of, StageRun) else of.ids[0]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="compare", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="*", metavar="RUN")
    parser.add_argument(
        "--last", type=int, metavar="2", help="the last two executions, or runs of --stage, of one profile"
    )
    parser.add_argument("--stage", help="a stage, or stage@item")
    parser.add_argument("--seeds", action="store_true", help="the last two groups of seeds, of --stage if it is given")
    parser.add_argument("--check", action="store_true", help="compare dvc.lock with MLflow instead")
    parser.add_argument("--profile", default="default", help="of --check: whose dvc.lock")
    parser.add_argument("--out", type=Path, default=COMPARISONS, help="folder for the page")
    stage_main(main, parser)
