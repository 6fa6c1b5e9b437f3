"""Tests of `pentimento doctor`: each fault that it knows is made, found, and named with what mends it."""

import fcntl
import os
import shutil
import socket
import sqlite3
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from pentimento.cli import doctor_computer, doctor_pipeline
from pentimento.cli.doctor_computer import GIB, disk, ports
from pentimento.cli.doctor_pipeline import dvc_cache, dvc_lock, package, store
from pentimento.cli.main import main
from pipelines._tracking.store import open_store, store_errors

PARTS = ("Python", "cores", "memory", "disk", "GPU", "browser", "serial ports", "git", "PyTorch", "DVC cache",
         "DVC lock", "MLflow store")  # fmt: skip


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder with what makes a clone of the project."""
    (tmp_path / "pipelines").mkdir()
    (tmp_path / ".dvc").mkdir()
    (tmp_path / "dvc.yaml").write_text("stages: {}\n")
    return tmp_path


@pytest.fixture
def server() -> Iterator[str]:
    """A server that says that it is healthy; its address."""

    class Healthy(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200 if self.path == "/health" else 404)
            self.end_headers()
            self.wfile.write(b"OK")

        def log_message(self, *_: object) -> None: ...

    serving = HTTPServer(("127.0.0.1", 0), Healthy)
    thread = threading.Thread(target=serving.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{serving.server_port}"
    serving.shutdown()
    thread.join()
    serving.server_close()


def without(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Let distributions be missing."""
    installed = doctor_computer.version
    for module in (doctor_computer, doctor_pipeline):
        monkeypatch.setattr(module, "version", lambda name: None if name in names else installed(name))


def test_a_line_says_what_each_part_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    assert main(["doctor"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert [part for part in PARTS if not any(line[7:].startswith(part) for line in lines)] == []
    assert {line.split()[0] for line in lines} <= {"ok", "note"}
    assert "no clone" in last


def test_a_lean_installation_misses_nothing_outside_of_a_clone_and_the_workshop_inside(
    clone: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    without(monkeypatch, "torch", "dvc", "mlflow", "lightning")
    (clone / "robot").mkdir()
    monkeypatch.chdir(clone / "robot")
    assert main(["doctor"]) == 0
    printed = capsys.readouterr().out
    assert "pip install '.[train]'" in printed and "wrong" not in printed
    monkeypatch.chdir(clone)
    assert main(["doctor"]) == 1
    printed = capsys.readouterr()
    assert all(f"wrong  {part}" in printed.out for part in ("PyTorch", "workshop", "DVC cache", "MLflow store"))
    assert "make env" in printed.out and "without lightning" in printed.out and "PyTorch" in printed.err


def test_the_store_that_mlflow_writes_is_current_and_other_schemas_are_named(
    clone: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = clone / "mlflow.db"
    assert store(clone, None).state == "ok"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{file}")
    with store_errors():
        open_store().search_experiments()
    assert store(clone, None) == store(clone, f"sqlite:///{file}") == store(clone, "sqlite:///mlflow.db")
    assert store(clone, None).state == "ok" and "as MLflow" in store(clone, None).text
    known, newest = doctor_pipeline._revisions()
    for revision, age in ((min(known - {str(newest)}), "older"), ("0123456789ab", "newer")):
        with sqlite3.connect(file) as connection:
            connection.execute("UPDATE alembic_version SET version_num = ?", [revision])
        connection.close()
        found = store(clone, None)
        assert found.state == "wrong" and age in found.text and found.mend
        assert (f"mlflow db upgrade sqlite:///{file}" in found.mend) == (age == "older")
    file.write_bytes(b"no database" * 1000)
    assert "damaged" in store(clone, None).text
    file.write_bytes(b"")
    assert store(clone, None).state == "ok"


def test_a_folder_is_no_store(clone: Path) -> None:
    assert store(clone, "mlruns").state == store(clone, "file:///mlruns").state == "wrong"


def test_a_password_is_not_printed(clone: Path) -> None:
    found = store(clone, "postgresql://user:secret@db.example.org:5432/runs")
    assert "db.example.org:5432/runs" in found.text and "secret" not in found.text


def test_a_server_is_asked(clone: Path, server: str) -> None:
    assert store(clone, server).state == "ok"
    found = store(clone, f"{server}/other")  # answers, with something else
    assert found.state == "wrong" and "404" in found.text


def test_a_server_that_is_silent_or_gone_is_named_in_time(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor_pipeline, "_SERVER_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"http://127.0.0.1:{silent.getsockname()[1]}"
        began = time.monotonic()
        found = store(clone, address)
        assert found.state == "wrong" and time.monotonic() - began < 5
    assert "refused" in store(clone, address).text
    assert found.mend and "unset MLFLOW_TRACKING_URI" in found.mend


def test_a_dvc_that_runs_and_a_conflict_in_its_lock_are_found(clone: Path) -> None:
    assert dvc_lock(clone).state == "ok"
    held = clone / ".dvc/tmp/lock"
    held.parent.mkdir()
    held.write_text(" 4711\n")
    with held.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert dvc_lock(clone).state == "note" and "4711" in dvc_lock(clone).text
    assert dvc_lock(clone).state == "ok"
    (clone / "dvc.lock").write_text("schema: '2.0'\n<<<<<<< HEAD\nstages: {}\n")
    assert dvc_lock(clone).state == "wrong" and "merge" in dvc_lock(clone).text


def test_the_cache_is_the_one_that_dvc_uses(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert str(clone / ".dvc/cache") in dvc_cache(clone).text
    (clone / ".dvc/config").write_text("[core]\n    analytics = false\n['remote \"shared\"']\n    url = /mnt/%s\n")
    (clone / ".dvc/config.local").write_text(f"[core]\n    no_scm = true\n[cache]\n    dir = {clone / 'shared'}\n")
    assert dvc_cache(clone).state == "ok" and str(clone / "shared") in dvc_cache(clone).text
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert dvc_cache(clone).state == "wrong" and "chown" in (dvc_cache(clone).mend or "")
    shutil.rmtree(clone / ".dvc")
    assert dvc_cache(clone).state == "wrong"


def test_a_full_disk_stops_and_a_small_one_is_noted(tmp_path: Path) -> None:
    assert [disk(free * GIB // 2, tmp_path).state for free in (1, 4, 100)] == ["wrong", "note", "ok"]


def test_ports_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert ports(tmp_path).text.startswith("none")
    (tmp_path / "ttyACM0").touch()
    assert ports(tmp_path).state == "ok" and "ttyACM0" in ports(tmp_path).text
    without(monkeypatch, "pyserial")
    assert "'.[grbl]'" in (ports(tmp_path).mend or "")
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "usermod" in (ports(tmp_path).mend or "")


def test_a_package_of_another_checkout_is_noted(tmp_path: Path) -> None:
    here, other = (tmp_path / name / "src/pentimento/__init__.py" for name in ("here", "other"))
    assert package(tmp_path / "here", here).state == "ok"
    found = package(tmp_path / "here", other)
    assert found.state == "note" and str(other.parent) in found.text and found.mend


@pytest.mark.parametrize(
    ("absent", "state", "mend", "words"),
    [
        (["lerobot"], "ok", None, "all others are installed; lerobot needs an environment of its own"),
        (["lerobot", "xarm"], "note", "pip install '.[xarm]'", "named after: xarm (a). lerobot needs an environment"),
        (["grbl", "xarm"], "note", "pip install '.[NAME]'", "named after: grbl (a); xarm (a)."),
        ([], "ok", None, "all are installed."),
    ],
)
def test_lerobot_is_left_out_of_the_advice_on_extras(
    monkeypatch: pytest.MonkeyPatch, absent: list[str], state: str, mend: str | None, words: str
) -> None:
    monkeypatch.setattr(doctor_computer, "extras", lambda: iter([(extra, ["a"]) for extra in absent]))
    monkeypatch.setattr(doctor_computer, "missing", list)
    found = doctor_computer._extras()
    assert (found.state, found.mend) == (state, mend) and words in found.text
    assert ("lerobot" in found.text) == ("lerobot" in absent)


def test_help_says_what_the_states_mean(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["doctor", "--help"])
    printed = capsys.readouterr().out
    assert [word for word in ("ok:", "note:", "wrong:", "exit status") if word not in printed] == []
