"""What `pentimento doctor` looks at for `make repro`: git, PyTorch, workshop, DVC's cache and lock, MLflow's store.

It reads DVC's and MLflow's files itself, so that it works where neither is installed, or installed whole.
"""

from __future__ import annotations

import configparser
import fcntl
import importlib.util
import os
import re
import shlex
import shutil
import sqlite3
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path
from typing import Final, Literal
from urllib.parse import urlsplit, urlunsplit

import pentimento
from pentimento.cli.doctor_computer import REINSTALL_TORCH, Finding, extras, install, missing, version

_SERVER_S: Final = 15.0
_OWN_LINES: Final = ("torch", "dvc", "mlflow")
"""Packages of the extra `train` with a line of their own."""
_REVISION: Final = re.compile(r"^(down_revision|revision)(?:: [^=]+)? = (?:['\"](\w+)['\"]|None)", re.MULTILINE)
_NOTHING: Final = "not installed; it belongs to the workshop (extra train), and bundles run without it."


def is_clone(root: Path) -> bool:
    """Whether a folder holds the pipeline."""
    return (root / "dvc.yaml").is_file() and (root / "pipelines").is_dir()


def pipeline(root: Path) -> list[Finding]:
    """Look at what `make repro` needs in `root`; outside of a clone, what is missing is no fault."""
    clone = is_clone(root)
    environment = [_environment(root), package(root, Path(pentimento.__file__))] if clone else []
    return [*environment, _git(root, clone), _pytorch(clone), _workshop(clone), dvc_cache(root), dvc_lock(root),
            store(root, os.environ.get("MLFLOW_TRACKING_URI"))]  # fmt: skip


def _environment(root: Path) -> Finding:
    """Whether the Python that looks is the one that `make repro` uses."""
    own = root / ".venv"
    if not own.exists():
        return Finding("note", "environment", "none yet; `make repro` makes it at first.", "make env")
    if not own.samefile(sys.prefix):
        text = f"this is {sys.prefix}, and `make repro` uses {own}: the lines below may not hold there."
        return Finding("note", "environment", text, f"{own}/bin/pentimento doctor")
    return Finding("ok", "environment", f"{own}.")


def package(root: Path, imported: Path) -> Finding:
    """Whether the package that Python imports, by the file of its ``__init__``, is the one of the clone."""
    if imported.resolve().is_relative_to((root / "src").resolve()):
        return Finding("ok", "package", f"{imported.parent}.")
    text = f"Python imports pentimento from {imported.parent}, not from this folder: changes here have no effect."
    return Finding("note", "package", text, "pip install --no-deps -e .")


def _git(root: Path, clone: bool) -> Finding:
    if shutil.which("git") is None:
        return Finding("wrong" if clone else "note", "git", "not installed.", "sudo apt install git")
    asked = subprocess.run(["git", "-C", root, "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    if asked.returncode == 0:
        return Finding("ok", "git", f"commit {asked.stdout[:10]}.")
    if not clone:
        return Finding("ok", "git", "installed.")
    reason = (asked.stderr.strip().splitlines() or ["it does not answer"])[0]
    mend = "git init && git add . && git commit -m 'First commit'"
    if "dubious ownership" in reason:
        mend = f"git config --global --add safe.directory {shlex.quote(str(root))}"
    return Finding("wrong", "git", f"cannot read this repository ({reason}).", mend)


def _pytorch(clone: bool) -> Finding:
    if version("torch") is None:
        return _lacking("PyTorch", _NOTHING, clone)
    try:
        import torch
    except Exception as error:  # whatever a broken library raises
        return _lacking("PyTorch", f"does not load ({str(error).splitlines()[0]}).", clone, reinstall=REINSTALL_TORCH)
    build = "CPU build" if torch.version.cuda is None else f"CUDA {torch.version.cuda}"
    return Finding("ok", "PyTorch", f"{torch.__version__} ({build}).")


def _workshop(clone: bool) -> Finding:
    """The packages of `train` without those that have lines, and the drawings that the first stage needs."""
    needed = dict(extras())
    names = [name for extra in ("train", "drawings") for name in needed.get(extra, []) if name not in _OWN_LINES]
    if lacking := missing(names):
        return _lacking("workshop", f"without {', '.join(lacking)} (extras train, drawings).", clone)
    return Finding("ok", "workshop", f"{len(names)} packages.")


def _lacking(part: str, text: str, clone: bool, *, reinstall: str | None = None) -> Finding:
    if not clone:
        return Finding("note", part, text, reinstall or install("train"))
    return Finding("wrong", part, text, reinstall or "rm -f .venv/.installed-* && make env")


def dvc_cache(root: Path) -> Finding:
    """Look at DVC and its cache."""
    clone, found = is_clone(root), version("dvc")
    if found is None:
        return _lacking("DVC cache", f"DVC is {_NOTHING}", clone)
    if not (root / ".dvc").is_dir():
        if not clone:
            return Finding("ok", "DVC cache", f"DVC {found}; no repository of DVC's is here.")
        return Finding("wrong", "DVC cache", "the folder .dvc is missing.", "git checkout -- .dvc")
    folder = root / ".dvc/cache"
    for name in ("config", "config.local"):
        parser = configparser.ConfigParser(interpolation=None)
        try:
            parser.read(root / ".dvc" / name)
        except configparser.Error as error:
            reason = str(error).splitlines()[0]
            return Finding("wrong", "DVC cache", f".dvc/{name} cannot be read ({reason}).", f"git diff .dvc/{name}")
        folder = root / ".dvc" / parser.get("cache", "dir", fallback=folder)
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if not os.access(there, os.W_OK | os.X_OK):
        text = f"{folder} cannot be written by you."
        return Finding("wrong", "DVC cache", text, f'sudo chown -R "$USER" {shlex.quote(str(there))}')
    state = "writable" if folder.is_dir() else "made by the first run"
    return Finding("ok", "DVC cache", f"DVC {found}; {folder}, {state}.")


def dvc_lock(root: Path) -> Finding:
    """Look at dvc.lock, which names the outputs, and at the lock of a DVC that is running."""
    names, held = root / "dvc.lock", root / ".dvc/tmp/lock"
    if held.is_file():
        with held.open() as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                owner = file.read().strip() or "unknown"
                text = f"another DVC (process {owner}) is running; `make repro` waits for it."
                return Finding("note", "DVC lock", text, f"kill {owner}, if it should not run")
    if names.is_file() and (problem := _problem_of(names)):
        return Finding("wrong", "DVC lock", f"dvc.lock {problem}.", "git checkout HEAD -- dvc.lock")
    return Finding("ok", "DVC lock", "free." if names.is_file() else "free; no output is known yet.")


def _problem_of(names: Path) -> str | None:
    """What is wrong with a dvc.lock that `make repro` does not put aside by itself."""
    try:
        text = names.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        return f"cannot be read ({error})"
    return "holds a conflict of a merge" if re.search(r"^<{7} ", text, re.MULTILINE) else None


def store(root: Path, address: str | None) -> Finding:
    """Look at MLflow's store: `address` as in MLFLOW_TRACKING_URI, by default mlflow.db in `root`."""
    clone, part = is_clone(root), "MLflow store"
    if address is None and not clone and not (root / "mlflow.db").exists():
        return (
            Finding("ok", part, "none here.") if version("mlflow") else _lacking(part, f"MLflow is {_NOTHING}", clone)
        )
    if version("mlflow") is None and clone:
        return _lacking(part, f"MLflow is {_NOTHING}", clone)
    address = _without_credentials(address or f"sqlite:///{root / 'mlflow.db'}")
    bad: Literal["wrong", "note"] = "wrong" if clone else "note"
    if address.startswith(("http://", "https://")):
        return _server(address, bad)
    if address.startswith("sqlite:///"):
        return _file(address, root / address.removeprefix("sqlite:///"), bad)
    if "://" not in address or address.startswith("file:"):
        text = f"{address} is a folder, which MLflow no longer writes to."
        return Finding(bad, part, text, "unset MLFLOW_TRACKING_URI")
    return Finding("note", part, f"{address}; only files and servers are looked at.")


def _without_credentials(address: str) -> str:
    """An address as it may be printed and asked, without a user's name and password."""
    parts = urlsplit(address)
    return address if parts.hostname is None else urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))


def _server(address: str, bad: Literal["wrong", "note"]) -> Finding:
    """Ask a server for its health, for at most 15 s altogether, whatever part of the network is slow."""
    answers: list[str] = []

    def ask() -> None:
        try:
            with urllib.request.urlopen(f"{address.rstrip('/')}/health", timeout=_SERVER_S) as answer:
                healthy = answer.read(16).strip() == b"OK"
            answers.append("" if healthy else "what answers is no MLflow server")
        except (OSError, ValueError) as error:
            answers.append(str(error))

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(_SERVER_S)
    reason = answers[0] if answers else f"no answer within {_SERVER_S:g} s"
    if not reason:
        return Finding("ok", "MLflow store", f"{address} answers.")
    text = f"{address} does not serve runs ({reason}); start it, or log into a file."
    return Finding(bad, "MLflow store", text, "unset MLFLOW_TRACKING_URI")


def _file(address: str, file: Path, bad: Literal["wrong", "note"]) -> Finding:
    quoted = shlex.quote(str(file))
    if not file.exists():
        if not os.access(file.parent, os.W_OK):
            return Finding(bad, "MLflow store", f"{file.parent} cannot be written by you.", "unset MLFLOW_TRACKING_URI")
        return Finding("ok", "MLflow store", f"{file}, made by the first run.")
    if not os.access(file, os.R_OK | os.W_OK):
        return Finding(bad, "MLflow store", f"{file} cannot be written by you.", f'sudo chown "$USER" {quoted}')
    try:
        found = _schema(file)
    except sqlite3.OperationalError as error:
        if "locked" in str(error):
            return Finding("note", "MLflow store", f"{file} is being written by another program.")
        return Finding(bad, "MLflow store", f"{file} holds no runs of MLflow ({error}).", f"mv {quoted} {quoted}.old")
    except sqlite3.DatabaseError as error:
        return Finding(bad, "MLflow store", f"{file} is damaged ({error}).", f"mv {quoted} {quoted}.damaged")
    if found is None:
        return Finding("ok", "MLflow store", f"{file}, empty; the first run fills it.")
    known, newest = _revisions()
    if newest is None:
        return Finding("ok", "MLflow store", f"{file}, readable; MLflow is not installed.")
    installed = f"MLflow {version('mlflow')}"
    if found == newest:
        return Finding("ok", "MLflow store", f"{file}, as {installed} writes it.")
    if found in known:
        text = f"{file} was written by an older MLflow than {version('mlflow')}."
        mend = f"cp {quoted} {quoted}.old && mlflow db upgrade {shlex.quote(address)}"
        return Finding(bad, "MLflow store", text, mend)
    text = f"{file} was written by a newer MLflow than {version('mlflow')}; install that, or begin another file."
    return Finding(bad, "MLflow store", text, f"mv {quoted} {quoted}.newer")


def _schema(file: Path) -> str | None:
    """The revision of a store's schema; None where the database is empty, which MLflow fills.

    Raises:
        sqlite3.DatabaseError: the file is no database, or not MLflow's (OperationalError).
    """
    connection = sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True, timeout=5)
    try:
        if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            return None
        row = connection.execute("SELECT version_num FROM alembic_version").fetchone()
    finally:
        connection.close()
    return None if row is None else str(row[0])


def _revisions() -> tuple[set[str], str | None]:
    """The schemas that the installed MLflow knows, and the newest, which none follows; read without importing it."""
    spec = importlib.util.find_spec("mlflow")
    if spec is None or spec.origin is None:
        return set(), None
    known, followed = set[str](), set[str]()
    for file in (Path(spec.origin).parent / "store/db_migrations/versions").glob("*.py"):
        for kind, revision in _REVISION.findall(file.read_text(encoding="utf-8")):
            (known if kind == "revision" else followed).add(revision)
    return known, next(iter(known - followed), None)
