"""MLflow's store, and the runs of executions in it.

The store is SQLite in the repository's root unless MLFLOW_TRACKING_URI names another. MLflow nests runs within one
experiment only. An execution of the pipeline therefore has a parent run in the experiment of each family of which a
stage ran. All parents have the execution's name as run name and as tag `execution`. `make repro` sets the name in the
environment; in `dvc exp run` it is the DVC experiment; a bare `dvc repro` has none.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from pentimento.contracts.errors import PentimentoError
from pipelines._tracking.families import experiment_tags
from pipelines._tracking.outbox import await_server

if TYPE_CHECKING:
    from mlflow import MlflowClient

VARIABLE = "PENTIMENTO_EXECUTION"
"""Environment variable of a stage: the name of the execution that it belongs to."""
GROUP_VARIABLE, SEED_VARIABLE = "PENTIMENTO_GROUP", "PENTIMENTO_SEED"
"""Environment variables of a stage in a group of runs with different seeds; also tags `group` and `seed`."""
EXECUTION, STAGE, PART = "execution", "stage", "part"
"""Values of the tag `kind`: a parent, a stage, a part of a stage."""
_SQLITE = "sqlite:///"
_SERVERS = ("http://", "https://")
_DATABASES = (_SQLITE, "postgresql", "mysql", "mssql")
_TEMPORARY = Path(".dvc/tmp/exps")
"""Where DVC runs queued experiments, in temporary copies of the repository."""
_PROFILES = ".profiles"
"""Where profiles run, in copies of the repository that are named for them; `.seed<k>` follows in a group of seeds."""


@contextmanager
def store_errors() -> Iterator[None]:
    """Turn errors of MLflow (a store that does not open, a full disk) into a PentimentoError."""
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
    """Return a client of the store; call inside `store_errors`, which sets the address."""
    from mlflow import MlflowClient

    address = os.environ["MLFLOW_TRACKING_URI"]
    if address.startswith(_DATABASES):
        _check_version(address)
    elif address.startswith(_SERVERS):
        await_server(address, execution_name())
    return MlflowClient(address)


def _check_version(address: str) -> None:
    """Refuse a database of another version of MLflow, which would upgrade some by itself and fail in others."""
    import mlflow
    from alembic.runtime.migration import MigrationContext
    from alembic.script import ScriptDirectory
    from sqlalchemy import create_engine

    if address.startswith(_SQLITE) and not Path(address.removeprefix(_SQLITE)).is_file():
        return  # it is about to be created
    engine = create_engine(address)
    try:
        with engine.connect() as connection:
            revision = MigrationContext.configure(connection).get_current_revision()
    finally:
        engine.dispose()
    known = ScriptDirectory(str(Path(mlflow.__file__).parent / "store/db_migrations"))
    if revision is None or revision == known.get_current_head():
        return
    store = address if address.startswith(_SQLITE) else '"$MLFLOW_TRACKING_URI"'  # which may hold a password
    if revision not in {script.revision for script in known.walk_revisions()}:
        raise PentimentoError(
            f"The database {store} is of a newer MLflow than {mlflow.__version__}, which does not know its revision "
            f"{revision}; install that newer version, or set MLFLOW_TRACKING_URI to another store."
        )
    raise PentimentoError(
        f"The database {store} is of an older MLflow than {mlflow.__version__}; copy it, then upgrade it by "
        f"`.venv/bin/mlflow db upgrade {store}`."
    )


def experiment_id(client: "MlflowClient", name: str) -> str:
    """Return the id of the experiment `name`; create it where there is none."""
    known, tags = client.get_experiment_by_name(name), experiment_tags(name)
    if known is not None:
        for tag in tags.keys() - known.tags.keys():  # of an earlier version; what a person wrote stays
            client.set_experiment_tag(known.experiment_id, tag, tags[tag])
        return known.experiment_id
    uri = os.environ["MLFLOW_TRACKING_URI"]
    beside = Path(uri.removeprefix("sqlite:///")).parent / "mlartifacts"
    location = beside.as_uri() if uri.startswith("sqlite:////") else None  # a server has its own location
    return client.create_experiment(name, artifact_location=location, tags=tags)


def execution_name() -> str:
    """Return the name of the execution that this process belongs to; empty where it has none."""
    name = os.environ.get(VARIABLE) or os.environ.get("DVC_EXP_NAME", "")
    return name.replace("'", "")  # which MLflow's queries cannot hold


def profile_name() -> str:
    """Return the profile of this process: what `make repro` set, else that of the copy in which it works."""
    folder = Path.cwd()
    copied = re.sub(r"\.seed\d+$", "", folder.name) if folder.parent.name == _PROFILES else "default"
    return os.environ.get("PENTIMENTO_PROFILE") or copied


def group_tags() -> dict[str, str]:
    """Return the tags of this process's group of seeds; empty where it belongs to none."""
    values = {"group": os.environ.get(GROUP_VARIABLE, ""), "seed": os.environ.get(SEED_VARIABLE, "")}
    return {name: value for name, value in values.items() if value}


def execution_run(client: "MlflowClient", experiment: str, execution: str, tags: dict[str, str]) -> str:
    """Return the id of the execution's run in an experiment (an id); create it with `tags` where there is none."""
    found = client.search_runs(
        [experiment], f"tags.kind = '{EXECUTION}' AND tags.execution = '{execution}'", max_results=1
    )
    if found:
        return found[0].info.run_id
    tags_of_kind = {"kind": EXECUTION, "execution": execution}
    return client.create_run(experiment, run_name=execution, tags=tags | tags_of_kind).info.run_id


def _settings() -> None:
    os.environ.setdefault("MLFLOW_TRACKING_URI", f"sqlite:///{_repository(Path.cwd()) / 'mlflow.db'}")
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("DO_NOT_TRACK", "true")
    os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "CRITICAL")  # its errors become sentences
    # MLflow tries for minutes; what a server does not take is kept (`outbox`).
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")


def _repository(folder: Path) -> Path:
    """Return the repository to whose history runs in `folder` belong."""
    if folder.parent.name == _PROFILES:
        return folder.parent.parent
    for above in folder.parents:
        if folder.is_relative_to(above / _TEMPORARY):
            return above
    return folder
