"""The run above the runs of one execution of the pipeline, one in each family's experiment.

MLflow nests runs within an experiment only, so that an execution has a parent in each experiment where a stage of
it ran. All of them bear the execution's name as run name and as tag `execution`. `make repro` names it in the
environment; of `dvc exp run` it is the DVC experiment. A bare `dvc repro` has none.
"""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mlflow import MlflowClient

VARIABLE = "PENTIMENTO_EXECUTION"
"""In the environment of a stage: the name of the execution that it belongs to."""
EXECUTION, STAGE, PART = "execution", "stage", "part"
"""Values of the tag `kind`: a parent, a stage, a part of a stage."""


def execution_name() -> str:
    """The execution that this process belongs to; empty where it has none."""
    name = os.environ.get(VARIABLE) or os.environ.get("DVC_EXP_NAME", "")
    return name.replace("'", "")  # which MLflow's queries cannot hold


def execution_run(client: "MlflowClient", experiment: str, execution: str, tags: dict[str, str]) -> str:
    """Return the id of the execution's run in an experiment (an id); it is made, with `tags`, where there is none."""
    found = client.search_runs(
        [experiment], f"tags.kind = '{EXECUTION}' AND tags.execution = '{execution}'", max_results=1
    )
    if found:
        return found[0].info.run_id
    own = {"kind": EXECUTION, "execution": execution}
    return client.create_run(experiment, run_name=execution, tags=tags | own).info.run_id
