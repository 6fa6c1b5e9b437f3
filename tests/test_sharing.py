"""The recipes of docs/sharing.md on a tiny pipeline: a second clone pulls the report and runs nothing."""

import os
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from moto.server import ThreadedMotoServer

from pipelines._params import read_yaml

PIPELINE = """\
stages:
  learn:
    cmd: python3 -c "import pathlib; pathlib.Path('ran.log').open('a').write('learn ');
      pathlib.Path('model').mkdir(); pathlib.Path('model/weights').write_text('learned')"
    outs: [model]
  report:
    cmd: python3 -c "import pathlib; pathlib.Path('ran.log').open('a').write('report ');
      pathlib.Path('report.html').write_text(pathlib.Path('model/weights').read_text())"
    deps: [model]
    outs: [report.html]
"""


def run(folder: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout + done.stderr


def dvc(folder: Path, *arguments: str) -> str:
    return run(folder, sys.executable, "-m", "dvc", *arguments)


def pipeline(folder: Path) -> None:
    """A repository in which the pipeline ran."""
    folder.mkdir()
    run(folder, "git", "init", "-q")
    dvc(folder, "init", "-q")
    (folder / "dvc.yaml").write_text(PIPELINE)
    (folder / ".gitignore").write_text("/model\n/report.html\n/ran.log\n")
    dvc(folder, "repro", "-q")
    assert (folder / "ran.log").read_text() == "learn report "


def git(folder: Path, *arguments: str) -> None:
    """Git with an author."""
    run(folder, "git", "-c", "user.name=a", "-c", "user.email=a@example.org", *arguments)


def clone(first: Path, second: Path) -> None:
    """As git has it, with all that is committed."""
    run(first, "git", "add", ".")
    git(first, "commit", "-qm", "Results")
    run(first.parent, "git", "clone", "-q", str(first), str(second))
    assert not (second / "report.html").exists()


def test_a_second_clone_pulls_and_has_nothing_to_run(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    pipeline(first)
    dvc(first, "remote", "add", "-q", "--default", "shared", str(tmp_path / "shared"))
    dvc(first, "push", "-q")
    clone(first, second)
    dvc(second, "pull", "-q")
    assert (second / "report.html").read_text() == "learned"
    assert "up to date" in dvc(second, "status")
    dvc(second, "repro", "-q")
    assert not (second / "ran.log").exists()
    locks = [read_yaml(folder / "dvc.lock") for folder in (first, second)]
    assert locks[0] == locks[1]


@pytest.fixture
def s3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Address of a server that speaks S3, with an empty bucket `results`; no credentials but those of a test."""
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        monkeypatch.delenv(name)
    (tmp_path / "empty").touch()
    for file in ("AWS_CONFIG_FILE", "AWS_SHARED_CREDENTIALS_FILE"):
        monkeypatch.setenv(file, str(tmp_path / "empty"))
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")  # else it is asked for credentials over the network
    server = ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    urllib.request.urlopen(urllib.request.Request(f"http://{host}:{port}/results", method="PUT")).close()
    yield f"http://{host}:{port}"
    server.stop()


def test_a_second_clone_pulls_from_a_server_that_speaks_s3(
    tmp_path: Path, s3: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With credentials from the environment, which no file and no log of the repository holds."""
    first, second = tmp_path / "first", tmp_path / "second"
    pipeline(first)
    dvc(first, "remote", "add", "-q", "--default", "team", "s3://results/pentimento")
    dvc(first, "remote", "modify", "-q", "team", "endpointurl", s3)
    without = subprocess.run([sys.executable, "-m", "dvc", "push"], cwd=first, capture_output=True, text=True)
    assert without.returncode != 0 and "Unable to locate credentials" in without.stderr
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "painter-of-the-team")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "pentimento-s3cret")
    said = dvc(first, "push", "-v")
    clone(first, second)
    said += dvc(second, "pull", "-v")
    assert (second / "report.html").read_text() == "learned"
    assert "up to date" in dvc(second, "status")
    dvc(second, "repro", "-q")
    assert not (second / "ran.log").exists()
    for folder in (first, second):
        assert "team" in (folder / ".dvc/config").read_text()
        written = b"".join(file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file())
        for secret in ("painter-of-the-team", "pentimento-s3cret"):
            assert secret not in said and secret.encode() not in written


def test_a_robot_gets_the_version_of_a_bundle_by_its_name(tmp_path: Path) -> None:
    """From git's address alone, without a clone and without the rest of the pipeline; versions are GTO's tags."""
    first, robot = tmp_path / "first", tmp_path / "robot"
    pipeline(first)
    artifact = "artifacts:\n  bundle: {path: model, type: bundle, desc: What the robot runs}\n"
    (first / "dvc.yaml").write_text(PIPELINE + artifact)
    dvc(first, "remote", "add", "-q", "--default", "shared", str(tmp_path / "shared"))
    dvc(first, "push", "-q")
    clone(first, tmp_path / "second")
    git(first, "tag", "-am", "First", "bundle@v1.0.0")
    (first / "dvc.yaml").write_text((PIPELINE + artifact).replace("'learned'", "'learned more'"))
    dvc(first, "repro", "-q")
    dvc(first, "push", "-q")
    git(first, "commit", "-qam", "More")
    git(first, "tag", "-am", "Second", "bundle@v1.1.0")
    robot.mkdir()
    for out, version, learned in (("newest", (), "learned more"), ("old", ("--rev", "v1.0.0"), "learned")):
        dvc(robot, "artifacts", "get", f"file://{first}", "bundle", *version, "--out", out)
        assert (robot / out / "weights").read_text() == learned
    assert sorted(path.name for path in robot.iterdir()) == ["newest", "old"]
