"""What a power cut or `kill -9` can do to dvc.lock: DVC empties the file before it writes it."""

import fcntl
import os
import sys
from pathlib import Path

from dvc.schema import COMPILED_LOCKFILE_SCHEMA
from voluptuous import Invalid

from pentimento.contracts.errors import ConfigError
from pipelines._config import read_yaml


def put_aside_broken_lock(folder: Path) -> None:
    """Rename a dvc.lock in `folder` that DVC cannot read, and say so: DVC finds again in its cache what stages made."""
    file, lock = folder / "dvc.lock", folder / ".dvc/tmp/lock"
    if not file.is_file() or not lock.is_file():  # where no DVC ever ran, none broke it
        return
    with lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_SH)  # or it may be another DVC's, half written
        try:
            COMPILED_LOCKFILE_SCHEMA(read_yaml(file))
        except (ConfigError, Invalid) as error:
            aside = file.with_name("dvc.lock.broken")
            os.replace(file, aside)
            print(
                f"make repro: {file} cannot be read ({error}); it is now {aside.name}. What its stages made is taken "
                "from DVC's cache.",
                file=sys.stderr,
            )
