"""`make repro SEEDS=5 STAGE=train_stroke_dynamics@marker`: one stage several times, with different seeds.

    python -m pipelines._seeds SEEDS STAGE [PROFILE]

Run number k adds k to every seed in the stage's section of params.yaml; number 0 is the run that `make repro` makes.
The stages that it needs keep their seeds, so that all runs read the same data. Each number has a copy of the
repository in `.profiles/<profile>.seed<k>/`, with the same DVC cache and MLflow store: the working tree stays as it is.
`python -m pipelines.compare --seeds` compares the last two groups.
"""

import os
import sys
import time
from pathlib import Path

from pentimento.contracts.errors import PentimentoError
from pipelines._dvc import put_aside_broken_lock, run_dvc
from pipelines._io import end_with_parent
from pipelines._params import overlaid, read_yaml, reseeded
from pipelines._repro import STATUS, name_files_of, overlay_with, restore_missing
from pipelines._review.agreement import link
from pipelines._review.groups import groups, spread
from pipelines._review.history import History
from pipelines._side_by_side import items_of
from pipelines._tracking.families import experiment_of, family_of
from pipelines._tracking.run import code_tags
from pipelines._tracking.store import (
    GROUP_VARIABLE,
    SEED_VARIABLE,
    VARIABLE,
    execution_run,
    experiment_id,
    group_tags,
    open_store,
    store_errors,
)


def main(arguments: list[str]) -> int:
    """Return the exit status."""
    if len(arguments) not in (2, 3):
        print(__doc__, file=sys.stderr)
        return 2
    if not arguments[0].isdecimal() or int(arguments[0]) < 2:
        print(
            f"make repro: SEEDS={arguments[0]} is no group of seeds; give a whole number from 2 on. "
            "A comparison of two groups needs 3.",
            file=sys.stderr,
        )
        return 2
    end_with_parent()
    count, target, profile = int(arguments[0]), arguments[1], arguments[2] if len(arguments) == 3 else None
    root = Path.cwd()
    os.environ.setdefault("MLFLOW_TRACKING_URI", f"sqlite:///{root / 'mlflow.db'}")
    os.environ["PENTIMENTO_PROFILE"] = profile or "default"
    group = f"{target} · {count} seeds · {time.strftime('%Y-%m-%d %H:%M:%S')}"
    try:
        for number in range(count):
            status = _run(root, target, profile, group=group, number=number)
            if status != 0:
                return status
        with store_errors():
            history = History()
            known = groups(history)
            lines = [line for each in known if each.name == group for line in spread(history, each)]
    except (PentimentoError, OSError) as error:
        print(f"make repro: {error}", file=sys.stderr)
        return 1
    print("\n".join(["", "Mean ± standard deviation over the seeds:", *lines] if lines else []))
    print(f"\nThe group:   {group}")
    if sum((each.stage, each.profile) == (target, profile or "default") for each in known) > 1:
        print(f"Against the group before: .venv/bin/python -m pipelines.compare --seeds --stage {target}")
    return 0


def _run(root: Path, target: str, profile: str | None, *, group: str, number: int) -> int:
    """Bring one run of the group up to date and tag it; return DVC's exit status."""
    params = reseeded(overlaid(root, profile) if profile else read_yaml(root / "params.yaml"), _stage(target), number)
    folder = overlay_with(root, f"{profile or 'default'}.seed{number}", params, profile)
    items_of(target, folder)
    put_aside_broken_lock(folder)
    name_files_of(folder, print)
    execution = f"{group} · {number}"
    os.environ |= {VARIABLE: execution, GROUP_VARIABLE: group, SEED_VARIABLE: str(number)}
    try:
        with store_errors():  # also where DVC finds everything done, so that the group is complete
            client, tags = open_store(), group_tags() | code_tags() | {"profile": profile or "default"}
            experiment = experiment_id(client, experiment_of(_stage(target)))
            execution_run(client, experiment, execution, tags | {"family": family_of(_stage(target))})
        print(f"\nSeed {number}:")
        status = run_dvc(["repro", target], folder)
        link(folder, execution, STATUS.get(status, "FAILED"))
    finally:
        for variable in (VARIABLE, GROUP_VARIABLE, SEED_VARIABLE):
            del os.environ[variable]
    if status != 0:
        restore_missing(folder)
    return status


def _stage(target: str) -> str:
    return target.partition("@")[0]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
