"""MLflow's store: SQLite in the repository's root unless MLFLOW_TRACKING_URI says otherwise; a client of it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from pentimento.contracts.errors import PentimentoError

if TYPE_CHECKING:
    from mlflow import MlflowClient

_TEMPORARY = Path(".dvc/tmp/exps")
"""Where DVC runs queued experiments, in copies of the repository that it removes."""


@contextmanager
def store_errors() -> Iterator[None]:
    """Turn what MLflow raises (a store that does not open, a full disk) into our sentence."""
    _settings()
    from alembic.util import CommandError
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError, CommandError) as error:
        root: BaseException = error
        while root.__cause__ is not None:
            root = root.__cause__
        store, reason = os.environ["MLFLOW_TRACKING_URI"], str(root).splitlines()[0]
        raise PentimentoError(f"MLflow's store {store} fails ({reason}); see its disk or address.") from None


def open_store() -> "MlflowClient":
    """Return a client of the store; inside `store_errors`, which names the store."""
    from mlflow import MlflowClient

    return MlflowClient(os.environ["MLFLOW_TRACKING_URI"])


def experiment_id(client: "MlflowClient", name: str) -> str:
    """Return the id of the experiment `name`, which is made where there is none."""
    known = client.get_experiment_by_name(name)
    if known is not None:
        return known.experiment_id
    uri = os.environ["MLFLOW_TRACKING_URI"]
    beside = Path(uri.removeprefix("sqlite:///")).parent / "mlartifacts"
    location = beside.as_uri() if uri.startswith("sqlite:////") else None  # a server has its own place
    return client.create_experiment(name, artifact_location=location)


def _settings() -> None:
    os.environ.setdefault("MLFLOW_TRACKING_URI", f"sqlite:///{_repository(Path.cwd()) / 'mlflow.db'}")
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("DO_NOT_TRACK", "true")
    os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "CRITICAL")  # what it raises is said in a sentence


def _repository(folder: Path) -> Path:
    """The repository to whose history runs in `folder` belong."""
    for above in folder.parents:
        if folder.is_relative_to(above / _TEMPORARY):
            return above
    return folder
