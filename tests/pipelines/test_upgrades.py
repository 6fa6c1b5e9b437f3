"""Databases of other versions of MLflow: the printed command upgrades an older one; a newer one is refused."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

from pentimento.contracts.errors import PentimentoError
from pipelines._tracking.store import open_store, store_errors

OLDER = "4465047574b1"  # of MLflow 2.11


def opened() -> int:
    with store_errors():
        return len(open_store().search_experiments())


def test_an_older_database_is_left_as_it_is_until_the_printed_command_upgrades_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from alembic import command
    from mlflow.store.db.utils import _get_alembic_config
    from mlflow.store.tracking.dbmodels.initial_models import Base

    file = tmp_path / "mlflow.db"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", address := f"sqlite:///{file}")
    engine = create_engine(address)
    Base.metadata.create_all(engine)
    command.upgrade(_get_alembic_config(address), OLDER)  # type: ignore[no-untyped-call]
    engine.dispose()
    before = file.read_bytes()
    with pytest.raises(PentimentoError, match="is of an older MLflow than") as refused:
        opened()
    assert file.read_bytes() == before
    printed = re.search(r"`\.venv/bin/mlflow (.*)`", str(refused.value))
    assert printed is not None
    subprocess.run([sys.executable, "-m", "mlflow", *shlex.split(printed[1])], check=True, capture_output=True)
    assert opened() == 1


def test_a_newer_database_is_refused(stage_folder: Path) -> None:
    assert opened() == 1
    engine = create_engine(f"sqlite:///{stage_folder / 'mlflow.db'}")
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = 'of_tomorrow'"))
    engine.dispose()
    with pytest.raises(PentimentoError, match=r"is of a newer MLflow than .* its revision of_tomorrow; install"):
        opened()
