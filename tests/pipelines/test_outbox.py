"""A tracking server that goes away while stages run: they go on, and nothing of what they log is lost."""

import http.server
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import requests
from mlflow import MlflowClient
from mlflow.exceptions import MlflowException

from pentimento.contracts.errors import PentimentoError
from pentimento.contracts.images import write_png
from pipelines._tracking import outbox, tracked_run
from pipelines._tracking import run as run_module

PICTURE = Path("strokes.png")


class Flaky:
    """MLflow's client on a server that can go away."""

    def __init__(self, client: MlflowClient) -> None:
        self.client, self.gone = client, False

    def __getattr__(self, name: str) -> Callable[..., Any]:
        method: Callable[..., Any] = getattr(self.client, name)

        def call(*arguments: Any, **keywords: Any) -> Any:
            if self.gone:
                raise MlflowException("API request failed") from requests.exceptions.ConnectionError("refused")
            return method(*arguments, **keywords)

        return call


@pytest.fixture
def server(stage_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Flaky:
    flaky = Flaky(MlflowClient())
    monkeypatch.setattr(run_module, "open_store", lambda: flaky)
    return flaky


def log_all(server: Flaky, gone_after: int) -> str:
    """A stage that logs one thing of each kind; the server goes away after so many of them. Returns the run's id."""
    write_png(PICTURE, np.full((4, 6, 3), 200, np.uint8))
    with tracked_run("paint", "colour", {"strokes": 3}, {"here": Path()}) as run:
        steps: list[Callable[[], None]] = [
            lambda: run.log_items("error", ["a", "b"], [1.0, 2.0]),
            lambda: run.log_metrics({"error": {"with_replanning": 0.5, "without_replanning": 0.6}}),
            lambda: run.log_picture(PICTURE),
            lambda: run.log_child("part", {"loss": {0: 3.0, 1: 2.0}}, {"why": "because"}),
            lambda: run.tag("said", "yes"),
        ]
        for number, step in enumerate(steps):
            server.gone = number >= gone_after
            step()
        PICTURE.unlink()
        server.gone = gone_after < len(steps)
    return run.id


def stored(server: Flaky, run_id: str) -> dict[str, Any]:
    """All that the store has of a run but its ids and times."""
    client = server.client
    run = client.get_run(run_id)
    children = client.search_runs([run.info.experiment_id], f"tags.`mlflow.parentRunId` = '{run_id}'")
    times = ("wall_s", "system/cpu_s", "system/peak_memory_mb")
    return {
        "status": run.info.status,
        "params": run.data.params,
        "metrics": {name: value for name, value in run.data.metrics.items() if name not in times},
        "timed": sorted(name for name in run.data.metrics if name in times),
        "items": [(point.step, point.value) for point in client.get_metric_history(run_id, "items.error")],
        "tags": {name: value for name, value in run.data.tags.items() if name in ("said", "items.error", "stage")},
        "inputs": [each.dataset.name for each in run.inputs.dataset_inputs],
        "pictures": [each.path for each in client.list_artifacts(run_id, "pictures")],
        "images": len(client.list_artifacts(run_id, "images")),
        "children": [
            (child.info.run_name, child.info.status, child.data.metrics, child.data.tags["why"]) for child in children
        ],
    }


@pytest.mark.parametrize("gone_after", range(5))
def test_what_a_server_did_not_take_is_sent_with_the_next_run(server: Flaky, gone_after: int) -> None:
    whole = stored(server, log_all(server, 99))
    assert whole["status"] == "FINISHED" and whole["children"] and whole["pictures"] and whole["images"]
    lost = log_all(server, gone_after)
    assert stored(server, lost)["status"] == "RUNNING" and list(outbox.UNSENT.glob("*.jsonl"))
    server.gone = False
    with tracked_run("report", None, {}, {}):
        pass
    assert stored(server, lost) == whole
    assert not list(outbox.UNSENT.iterdir())


def test_a_server_that_is_back_before_a_stage_ends_has_it_all(server: Flaky) -> None:
    with tracked_run("paint", None, {}, {}) as run:
        server.gone = True
        run.tag("said", "yes")
        run.log("loss", 1.0, 4)
        server.gone = False
    assert server.client.get_run(run.id).data.tags["said"] == "yes"
    assert server.client.get_metric_history(run.id, "loss")[0].step == 4
    assert server.client.get_run(run.id).info.status == "FINISHED"
    assert not list(outbox.UNSENT.iterdir())


def test_sending_stops_where_the_server_goes_away_and_goes_on_from_there(server: Flaky) -> None:
    lost = log_all(server, 0)
    left = len((outbox.UNSENT / f"{lost}.jsonl").read_text().splitlines())
    server.gone = False
    log_batch, sent = server.client.log_batch, []

    def once(*arguments: Any, **keywords: Any) -> None:
        log_batch(*arguments, **keywords)
        sent.append(1)
        server.gone = True

    server.client.log_batch = once  # type: ignore[method-assign]
    outbox.send_unsent(server)  # type: ignore[arg-type]
    server.client.log_batch = log_batch  # type: ignore[method-assign]
    assert sent == [1] and 0 < len((outbox.UNSENT / f"{lost}.jsonl").read_text().splitlines()) < left
    server.gone = False
    outbox.send_unsent(server)  # type: ignore[arg-type]
    assert stored(server, lost)["status"] == "FINISHED" and len(stored(server, lost)["children"]) == 1


def test_entries_of_a_run_that_is_still_running_are_not_sent_by_others(server: Flaky) -> None:
    with tracked_run("paint", None, {}, {}) as run:
        server.gone = True
        run.tag("said", "yes")
        server.gone = False
        outbox.send_unsent(server)  # type: ignore[arg-type]
        assert (outbox.UNSENT / f"{run.id}.jsonl").exists()
    assert server.client.get_run(run.id).data.tags["said"] == "yes"


def test_other_errors_of_the_store_are_raised(server: Flaky) -> None:
    with pytest.raises(PentimentoError, match="store"), tracked_run("paint", None, {}, {}) as run:
        server.client.delete_run(run.id)
        run.tag("said", "yes")


@pytest.fixture
def address() -> Iterator[str]:
    """Where a server will be, half a second later."""

    class Healthy(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            """Nothing."""

    later = http.server.HTTPServer(("127.0.0.1", 0), Healthy, bind_and_activate=False)
    later.server_bind()

    def start() -> None:
        time.sleep(0.5)
        later.server_activate()
        later.serve_forever(poll_interval=0.05)

    thread = threading.Thread(target=start, daemon=True)
    thread.start()
    yield f"http://user:secret@127.0.0.1:{later.server_port}"
    later.shutdown()
    later.server_close()
    thread.join()


def test_a_server_is_waited_for_longer_where_it_answered_before(
    address: str, stage_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outbox.await_server(address, "this execution")  # half a second
    for name, seconds in (("_ANSWER_S", 0.05), ("_PATIENCE_S", 0.6), ("_POLL_S", 0.05)):
        monkeypatch.setattr(outbox, name, seconds)
    waited = {}
    for execution in ("this execution", "another"):
        started = time.monotonic()
        with pytest.raises(PentimentoError, match=r"http://127.0.0.1:9 does not answer \(.*refused\); start it"):
            outbox.await_server("http://user:secret@127.0.0.1:9", execution)
        waited[execution] = time.monotonic() - started
    assert waited["this execution"] >= 0.6 > 0.5 > waited["another"]
