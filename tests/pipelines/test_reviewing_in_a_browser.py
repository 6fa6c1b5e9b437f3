"""A reviewer before MLflow's own page, served on this computer, and before the page of a comparison, in Chromium.

How each question is answered: which execution is better (three clicks), which data and parameters (the run's page),
show me the pictures (three clicks there), what changed and is it luck (one command, whose page needs no server).
Screenshots of each answer are kept in the folder that PENTIMENTO_SCREENSHOTS names, by default pytest's own.
"""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipelines import compare
from pipelines._review.history import History
from pipelines._review.view import address_of
from tests.browser import CHROMIUM, Browser, browser
from tests.pipelines.history import execute, repository

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this computer: a reviewer's clicks are not tested"),
    pytest.mark.timeout(900),  # a server and a browser start
]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a server on this computer, and two executions in its store, tracked through it."""
    folder = tmp_path_factory.mktemp("server")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [
        sys.executable, "-m", "mlflow", "server", "--workers", "1", "--host", "127.0.0.1", "--port", str(port),
        "--backend-store-uri", f"sqlite:///{folder / 'mlflow.db'}", "--artifacts-destination", str(folder / "served"),
    ]  # fmt: skip
    log = (folder / "log").open("wb")
    plain = os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
    process = subprocess.Popen(command, cwd=folder, env=plain, stdout=log, stderr=log, start_new_session=True)
    address = f"http://127.0.0.1:{port}"
    try:
        _wait_for(f"{address}/health", process, folder / "log")
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            patch.setenv("MLFLOW_TRACKING_URI", address)
            repository(folder)
            for number, (name, error) in enumerate((("before", 0.30), ("after", 0.20))):
                execute(name, 4 + number, error, patch, ("train_stroke_dynamics",))
            patch.delenv("PENTIMENTO_EXECUTION")
            yield address
    finally:
        os.killpg(process.pid, signal.SIGKILL)  # it and its worker; nothing of theirs is wanted any more
        process.wait()
        log.close()


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture
def screenshots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    named = os.environ.get("PENTIMENTO_SCREENSHOTS")
    return Path(named) if named else tmp_path_factory.getbasetemp() / "screenshots"


def test_an_experiment_opens_on_its_training_runs(server: str, tab: Browser, screenshots: Path) -> None:
    """After one click on *Model training* in a browser that never saw MLflow; no tabs of traces and judges."""
    tab.goto(f"{server}/#/experiments")
    tab.click(_named("Model training"))
    tab.click(_named("pentimento/strokes"))
    tab.wait(_seen("before"))
    tab.screenshot(screenshots / "experiment.png")
    assert "/runs" in tab.evaluate("location.hash")
    said = tab.text()
    assert "Judges" not in said and "Models" in said


def test_pictures_of_runs_meet_in_the_image_grid(server: str, tab: Browser, screenshots: Path) -> None:
    """In the chart view of the experiment, whose rows are executions."""
    tab.goto(f"{server}/#/experiments/{_strokes(server)}/runs?compareRunsMode=CHART")
    tab.wait(_seen("train_stroke_dynamics/marker/strokes"))
    alike = "[...document.querySelectorAll('img')].filter(i => Math.abs(i.naturalWidth / i.naturalHeight - 1.5) < 0.02)"
    tab.wait(f"{alike}.length === 2", 30)  # the pictures have 60 by 40 pixels; MLflow shows copies of another size
    tab.screenshot(screenshots / "grid.png")


def test_a_models_page_leads_to_data_run_and_files(server: str, tab: Browser, screenshots: Path) -> None:
    run = next(run for run in History().runs if run.tags["execution"] == "after")
    model = run.tags["model:models/stroke_marker_base/weights"]
    tab.goto(f"{server}/#/experiments/{_strokes(server)}/models/{model}?workflowType=machine_learning")
    for text in ("held_out.model.mse", "dvc://", "data/strokes", "Made by the robot in the studio"):
        tab.wait(_seen(text), 30)
    tab.screenshot(screenshots / "model.png")
    described = f"[...document.querySelectorAll('a')].find(a => a.innerText === {run.name!r})"  # opens another tab
    assert tab.evaluate(f"{described}.href").endswith(f"/#/experiments/{_strokes(server)}/runs/{run.id}")
    tab.click(_named(run.id))
    tab.wait(f"location.hash.includes({run.id!r})", 30)


def test_which_is_better_is_three_clicks_away(server: str, tab: Browser, screenshots: Path) -> None:
    """Tick both executions, press Compare."""
    experiment = _strokes(server)
    tab.goto(f"{server}/#/experiments/{experiment}/runs?workflowType=machine_learning")
    tab.tick(_box_of("before"), _box_of("after"))
    tab.wait(_button("Compare"))
    tab.screenshot(screenshots / "executions.png")
    tab.click(_button("Compare"))
    tab.wait(_seen("Comparing 2 Runs"))
    tab.wait(_seen("train_stroke_dynamics/marker/held_out.polyline.mse"))
    said = tab.text()
    assert "0.298" in said and "0.198" in said  # the main figure of both
    tab.evaluate(f"({_named('Metrics')}).scrollIntoView()")
    tab.screenshot(screenshots / "compared_in_mlflow.png")


def test_a_runs_page_says_what_it_was_and_its_pictures_are_three_clicks_away(
    server: str, tab: Browser, screenshots: Path
) -> None:
    """Open the run: its note, data, parameters and tags are there; the tab of artifacts has the picture."""
    run = next(run for run in History().runs if run.tags["execution"] == "after")
    tab.goto(f"{server}/#/experiments/{_strokes(server)}/runs/{run.id}")
    for text in ("Train Traj2Stroke", "strokes", "epochs", "held_out.model.mse", "output:models/stroke_marker_base"):
        tab.wait(_seen(text))
    tab.screenshot(screenshots / "run.png")
    tab.click(_named("Artifacts"))
    tab.click(_named("pictures"))
    tab.click(_named("strokes.png"))
    tab.wait("[...document.querySelectorAll('img')].some(i => i.naturalWidth === 60)")
    tab.screenshot(screenshots / "picture.png")


def test_is_it_luck_is_one_command(
    server: str, tab: Browser, screenshots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    compare.main(compare.command_line().parse_args(["--last", "2", "--out", str(tmp_path)]))
    assert "B is better; beyond luck" in capsys.readouterr().out
    (page,) = tmp_path.glob("*.html")
    tab.goto(page.as_uri())
    said = tab.text()
    assert "1 parameter differs: train_stroke_dynamics@marker: epochs." in said
    assert "B is better; beyond luck" in said
    broken = tab.evaluate("[...document.images].filter(i => !i.complete || !i.naturalWidth).length")
    wider = tab.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    asked = tab.evaluate("performance.getEntriesByType('resource').filter(e => !e.name.startsWith('data:')).length")
    assert (tab.evaluate("document.images.length"), broken, wider, asked) == (3, 0, 0, 0)
    tab.click("document.querySelector('td a, th a')")
    tab.wait("location.hash === '#train-stroke-dynamics-marker'")
    tab.screenshot(screenshots / "comparison.png", whole=True)
    tab.resize(420, 900)  # a telephone
    assert tab.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth") == 0
    tab.resize(1500, 1000)


def test_a_link_opens_on_the_main_figures(server: str, tab: Browser, screenshots: Path) -> None:
    """As columns of the table; and as a chart, in a section of their own. In a browser that never saw MLflow."""
    experiment = _strokes(server)
    address = f"{server}/{address_of(experiment)}"
    tab.goto(address)
    for name in ("held_out.model.mse", "held_out.polyline.mse"):
        tab.wait(_seen(f"train_stroke_dynamics/marker/{name}"), 30)
    tab.wait(_seen("before"))
    tab.screenshot(screenshots / "main_figures.png")
    linked = f"[...document.querySelectorAll('a')].some(a => a.getAttribute('href') === {address_of(experiment)!r})"
    tab.wait(linked, 30)  # in the experiment's description
    tab.goto(f"{address}&compareRunsMode=CHART")
    tab.wait(_seen("Main figures"), 30)
    tab.screenshot(screenshots / "main_charts.png")


def _strokes(server: str) -> str:
    from mlflow import MlflowClient

    experiment = MlflowClient(server).get_experiment_by_name("pentimento/strokes")
    assert experiment is not None
    return str(experiment.experiment_id)


def _seen(text: str) -> str:
    return f"document.body.innerText.includes({text!r})"


def _button(text: str) -> str:
    return f"[...document.querySelectorAll('button:enabled')].find(b => b.innerText.trim() === {text!r})"


def _named(text: str) -> str:
    """The innermost element that says this and can be seen."""
    return (
        "[...document.querySelectorAll('a, button, span, div, li')]"
        f".filter(e => e.innerText && e.innerText.trim() === {text!r} && e.getClientRects().length).at(-1)"
    )


def _box_of(name: str) -> str:
    row = f"[...document.querySelectorAll('[role=row]')].find(r => r.innerText.includes({name!r}))"
    return f"({row})?.querySelector('.ag-selection-checkbox input')"


def _wait_for(address: str, process: "subprocess.Popen[bytes]", log: Path) -> None:
    end = time.monotonic() + 500
    while True:
        try:
            with urllib.request.urlopen(address, timeout=5):
                return
        except OSError:
            assert process.poll() is None and time.monotonic() < end, log.read_text()
            time.sleep(0.3)
