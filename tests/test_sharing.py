"""The recipe of docs/sharing.md on a tiny pipeline: a second clone pulls the report and runs nothing."""

import subprocess
import sys
from pathlib import Path

from pipelines._config import read_yaml

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
    return done.stdout


def dvc(folder: Path, *arguments: str) -> str:
    return run(folder, sys.executable, "-m", "dvc", *arguments)


def test_a_second_clone_pulls_and_has_nothing_to_run(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    run(first, "git", "init", "-q")
    dvc(first, "init", "-q")
    (first / "dvc.yaml").write_text(PIPELINE)
    (first / ".gitignore").write_text("/model\n/report.html\n/ran.log\n")
    dvc(first, "repro", "-q")
    assert (first / "ran.log").read_text() == "learn report "
    dvc(first, "remote", "add", "-q", "--default", "shared", str(tmp_path / "shared"))
    dvc(first, "push", "-q")
    run(first, "git", "add", ".")
    run(first, "git", "-c", "user.name=a", "-c", "user.email=a@example.org", "commit", "-qm", "Results")

    run(tmp_path, "git", "clone", "-q", str(first), str(second))
    assert not (second / "report.html").exists()
    dvc(second, "pull", "-q")
    assert (second / "report.html").read_text() == "learned"
    assert "up to date" in dvc(second, "status")
    dvc(second, "repro", "-q")
    assert not (second / "ran.log").exists()
    locks = [read_yaml(folder / "dvc.lock") for folder in (first, second)]
    assert locks[0] == locks[1]
