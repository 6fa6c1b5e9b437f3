"""How an experiment opens in MLflow: its main figures as columns and charts, by a link that anyone can follow.

MLflow's page keeps the choice of columns and charts in the browser. A choice that is shared is kept as a tag of the
experiment, and `viewStateShareKey` in the page's address names it.
"""

import base64
import json
import zlib
from collections.abc import Iterable
from typing import Any

from mlflow import MlflowClient

from pipelines._tracking.families import HEADLINES, experiment_tags

KEY = "main_figures"
_TAG = f"mlflow.sharedViewState.{KEY}"
_NOTE = "mlflow.note.content"
_COMPRESSED = "deflate;"
_SECTION = "main_figures"
_RUNS = 10  # whose bars a chart shows


def address_of(experiment: str) -> str:
    """Return the address, below the server's, of the training runs of an experiment with its main figures."""
    return f"#/experiments/{experiment}/runs?viewStateShareKey={KEY}&workflowType=machine_learning"


def share_view(client: MlflowClient, experiment: str, metrics: Iterable[str]) -> None:
    """Let `address_of(experiment)` show the main figures among the `metrics` of its executions.

    The experiment's description has the address as a link, except where a person wrote the description.
    """
    state = json.dumps(view_of(metrics), sort_keys=True)
    packed = base64.b64encode(zlib.compress(state.encode(), 9)).decode()
    client.set_experiment_tag(experiment, _TAG, f"{_COMPRESSED}{packed}")
    stored = client.get_experiment(experiment)
    written = experiment_tags(stored.name)[_NOTE]
    if stored.tags.get(_NOTE) == written:  # what a person wrote stays
        link = f"[Executions with their main figures]({address_of(experiment)})"
        first, _, rest = written.partition("\n\n")  # of a folded description, MLflow shows the first paragraph
        client.set_experiment_tag(experiment, _NOTE, f"{first} {link}.\n\n{rest}")


def view_of(metrics: Iterable[str]) -> dict[str, Any]:
    """Return the state of MLflow's page: a column for each main figure and its baseline, a chart for each main figure.

    Metrics of an execution are called stage/item/figure.
    """
    known = sorted(metrics)
    figures = {stage: [each for each in (line.metric, line.baseline) if each] for stage, line in HEADLINES.items()}
    main = [name for stage, (first, *_) in figures.items() for name in known if _shows(name, stage, first)]
    shown = [
        name for stage, wanted in figures.items() for name in known for each in wanted if _shows(name, stage, each)
    ]
    charts = [
        {
            "type": "BAR", "uuid": f"{_SECTION}_{number}", "metricKey": name, "metricSectionId": _SECTION,
            "runsCountToCompare": _RUNS, "deleted": False, "isGenerated": False,
        }
        for number, name in enumerate(main)
    ]  # fmt: skip
    return {
        "selectedColumns": ["attributes.`Created`", *(f"metrics.`{name}`" for name in shown)],
        "runsExpanded": {},
        "compareRunCharts": charts,
        "compareRunSections": [{"uuid": _SECTION, "name": "Main figures", "display": True, "isReordered": False}],
        "isAccordionReordered": True,  # else MLflow sorts this section among its own
    }


def _shows(name: str, stage: str, figure: str) -> bool:
    return name.startswith(f"{stage}/") and name.endswith(f"/{figure}")
