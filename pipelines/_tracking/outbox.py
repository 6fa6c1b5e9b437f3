"""What a tracking server did not take: kept in `.pentimento/unsent/`, and sent with a later run.

A server may go away while a stage runs. The stage then goes on. Each run has a file of entries, one JSON object a line
in the order in which they were logged, and copies of its pictures. A process holds a lock on the file of its own run;
others send only files that nobody holds. To send an entry twice does no harm, but for a child run.
"""

import json
import shutil
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock, Timeout

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import PentimentoError

if TYPE_CHECKING:
    from mlflow import MlflowClient

UNSENT = Path(".pentimento/unsent")
_REACHED = UNSENT.parent / "reached.json"
_ANSWER_S = 8.0
"""Within which a server must answer the first request of a process."""
_PATIENCE_S = 120.0
"""How long a stage waits for a server that answered an earlier stage of the same execution."""
_POLL_S = 1.0
_GONE = (502, 503, 504)
"""HTTP statuses of a server that is not there behind a proxy."""
_PARAMS_A_BATCH = 100  # MLflow's limit
Entry = dict[str, Any]
Point = tuple[str, float, int, int]
"""Name, value, time in ms, step."""


def await_server(address: str, execution: str) -> None:
    """Wait until a server answers; its first answer in an execution is noted.

    Raises:
        PentimentoError: it does not, within 8 s, or two minutes where it did earlier in this execution.
    """
    known = execution and _REACHED.is_file() and _REACHED.read_text(encoding="utf-8") == json.dumps(execution)
    patience_s = _PATIENCE_S if known else _ANSWER_S
    started = time.monotonic()
    while (reason := _silent(address)) and time.monotonic() - started < patience_s:
        time.sleep(_POLL_S)
    if reason:
        raise PentimentoError(
            f"The tracking server {_public(address)} does not answer ({reason}); start it, or unset "
            "MLFLOW_TRACKING_URI to log into a file."
        )
    _REACHED.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(_REACHED, json.dumps(execution).encode())


def _silent(address: str) -> str:
    """Return why a server does not answer; empty where it does."""
    try:
        with urllib.request.urlopen(f"{_public(address).rstrip('/')}/health", timeout=_ANSWER_S):
            return ""
    except urllib.error.HTTPError as error:  # it answers, such as a server that asks for a password
        return f"status {error.code}" if error.code in _GONE else ""
    except (OSError, ValueError) as error:
        return str(getattr(error, "reason", error))


def _public(address: str) -> str:
    """Return an address without a user's name and password."""
    scheme, _, rest = address.partition("://")
    host, slash, path = rest.partition("/")
    return f"{scheme}://{host.rpartition('@')[2]}{slash}{path}"


class Outbox:
    """The entries of one run on their way to the store."""

    def __init__(self, client: "MlflowClient", run_id: str) -> None:
        UNSENT.mkdir(parents=True, exist_ok=True)
        self._client, self._run, self._file = client, run_id, UNSENT / f"{run_id}.jsonl"
        self._lock = FileLock(f"{self._file}.lock")
        self._lock.acquire()

    def send(self, operation: str, **values: Any) -> None:
        """Carry out an operation of `_OPERATIONS` on the run, or keep it where the server is gone."""
        entry = {"operation": operation, "run": self._run} | values
        if not self._file.exists():
            if _done(self._client, entry):
                return
            print(
                "The tracking server does not answer: what this stage logs is kept in "
                f"{UNSENT} and sent with a later run.",
                file=sys.stderr,
            )
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(_with_copies(entry, self._file.with_suffix(""))) + "\n")

    def close(self) -> None:
        """Send what was kept, if the server is back, and leave the rest to a later run."""
        if self._file.exists():
            _send(self._client, self._file)
        _unlock(self._lock)


def send_unsent(client: "MlflowClient") -> None:
    """Send what runs that have ended could not; stop where the server is gone."""
    for file in sorted(UNSENT.glob("*.jsonl")):
        with _held(file) as held:
            if held and not _send(client, file):
                return


@contextmanager
def _held(file: Path) -> Iterator[bool]:
    """Whether the lock of a run's file could be taken: nobody writes it."""
    lock = FileLock(f"{file}.lock")
    try:
        lock.acquire(blocking=False)
    except Timeout:
        yield False
        return
    try:
        yield file.exists()
    finally:
        _unlock(lock)


def _unlock(lock: FileLock) -> None:
    """Delete the lock's file while it is held: nobody can hold a file that is deleted later."""
    Path(lock.lock_file).unlink(missing_ok=True)
    lock.release()


def _send(client: "MlflowClient", file: Path) -> bool:
    """Send a run's entries in order; return whether all were taken. Those that were not stay."""
    lines = file.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines):
        if not _done(client, json.loads(line)):
            atomic_write(file, "".join(f"{rest}\n" for rest in lines[number:]).encode())
            return False
    file.unlink()
    shutil.rmtree(file.with_suffix(""), ignore_errors=True)
    return True


def _done(client: "MlflowClient", entry: Entry) -> bool:
    """Carry out an entry; False where the server is gone. Other errors of the store are raised."""
    from mlflow.exceptions import MlflowException

    values = {name: value for name, value in entry.items() if name != "operation"}
    try:
        _OPERATIONS[entry["operation"]](client, **values)
    except MlflowException as error:
        if _is_outage(error):
            return False
        raise
    return True


def _is_outage(error: BaseException) -> bool:
    """Whether an error comes of a server that cannot be reached or does not answer."""
    from requests.exceptions import RequestException

    status = getattr(error, "get_http_status_code", lambda: None)()
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, RequestException):
            return True
        seen = seen.__cause__ or seen.__context__
    return status in _GONE


def _with_copies(entry: Entry, folder: Path) -> Entry:
    """Return an entry that names a copy of its file, which the stage may move or delete."""
    if "file" not in entry:
        return entry
    copy = folder / str(time.monotonic_ns()) / Path(entry["file"]).name
    copy.parent.mkdir(parents=True)
    shutil.copy2(entry["file"], copy)
    return entry | {"file": str(copy)}


def _described(
    client: "MlflowClient", run: str, params: Mapping[str, str], inputs: Sequence[tuple[str, str, str]]
) -> None:
    """The parameters of a run; its inputs as (label, digest, path)."""
    from mlflow.entities import Dataset, DatasetInput, InputTag, Param

    flat = [Param(name, value) for name, value in params.items()]
    for first in range(0, len(flat), _PARAMS_A_BATCH):
        client.log_batch(run, params=flat[first : first + _PARAMS_A_BATCH])
    datasets = [
        DatasetInput(
            Dataset(label, digest, "local", json.dumps({"uri": path})), [InputTag("mlflow.data.context", "input")]
        )
        for label, digest, path in inputs
    ]
    if datasets:
        client.log_inputs(run, datasets=datasets)


def _metrics(client: "MlflowClient", run: str, points: Sequence[Point]) -> None:
    from mlflow.entities import Metric

    client.log_batch(run, metrics=[Metric(*point) for point in points])


def _tags(client: "MlflowClient", run: str, tags: Mapping[str, str]) -> None:
    from mlflow.entities import RunTag

    client.log_batch(run, tags=[RunTag(name, value) for name, value in tags.items()])


def _artifact(client: "MlflowClient", run: str, file: str, folder: str) -> None:
    client.log_artifact(run, file, folder)


def _image(client: "MlflowClient", run: str, file: str, key: str, step: int) -> None:
    from PIL import Image

    with Image.open(file) as picture:
        client.log_image(run, picture, key=key, step=step)


def _child(client: "MlflowClient", run: str, name: str, points: Sequence[Point], tags: Mapping[str, str]) -> None:
    """A finished run below this one, with the tags of this one that say where it belongs."""
    parent = client.get_run(run)
    own = {"mlflow.parentRunId": run} | {
        tag: parent.data.tags[tag] for tag in ("stage", "item", "execution") if tag in parent.data.tags
    }
    child = client.create_run(parent.info.experiment_id, run_name=name, tags=own | dict(tags)).info.run_id
    _metrics(client, child, points)
    client.set_terminated(child, "FINISHED")


def _ended(client: "MlflowClient", run: str, also: Sequence[str], status: str) -> None:
    """The run and others have ended."""
    for each in (run, *also):
        client.set_terminated(each, status)


_OPERATIONS: dict[str, Callable[..., None]] = {
    "described": _described,
    "metrics": _metrics,
    "tags": _tags,
    "artifact": _artifact,
    "image": _image,
    "child": _child,
    "ended": _ended,
}
