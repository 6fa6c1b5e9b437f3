import os
import subprocess
from pathlib import Path

import pytest

from pentimento.contracts.errors import ConfigError, PentimentoError
from pipelines._params import merge, read_yaml
from pipelines._progress_views import View
from pipelines._repro import main, overlay, restore_missing
from pipelines._side_by_side import Outcome
from pipelines._tracking.store import VARIABLE

SOURCE = Path("profiles/smoke.yaml")


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    files = {
        "params.yaml": "paint: {strokes: 300, rate: 1e-3}\nreport: {size_px: 3}\n",
        "profiles/smoke.yaml": "paint: {strokes: 2}\n",
        "pipelines/paint.py": "one\n",
        "pipelines/old.py": "old\n",
        "dvc.lock": "stages: {}\n",
        ".dvc/config": "[core]\n    analytics = false\n",
        ".gitignore": "/data/\n/.profiles/\n/.dvc/cache\n/.dvc/tmp\n",
        "data/strokes/part": "an output\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    subprocess.run(["git", "add", "."], cwd=tmp_path, check=True)
    return tmp_path


def test_merge_overrides_what_is_there() -> None:
    base = {"paint": {"strokes": 300, "press": {"depth_m": 1}}, "report": {}}
    merged = merge(base, {"paint": {"press": {"depth_m": 2}}}, SOURCE)
    assert merged == {"paint": {"strokes": 300, "press": {"depth_m": 2}}, "report": {}}
    assert base["paint"] == {"strokes": 300, "press": {"depth_m": 1}}


def test_merge_puts_in_and_leaves_out_optional_sections() -> None:
    base = {"scenes": {"imported": None, "drawn": {"side_px": 64}}}
    merged = merge(base, {"scenes": {"imported": {"path": "coco"}, "drawn": None}}, SOURCE)
    assert merged == {"scenes": {"imported": {"path": "coco"}, "drawn": None}}


@pytest.mark.parametrize(
    ("over", "sentence"),
    [
        (
            {"paint": {"press": {"dept_m": 2}}},
            r"profiles/smoke\.yaml: paint\.press\.dept_m is not in params\.yaml",
        ),
        ({"paint": 3}, r"paint is a section in one file and a value in the other"),
        (
            {"paint": {"strokes": {"x": 1}}},
            r"paint\.strokes is a section in one file and a value in the other",
        ),
    ],
)
def test_merge_refuses_what_is_not(over: dict[str, object], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        merge({"paint": {"strokes": 300, "press": {"depth_m": 1}}}, over, SOURCE)


def test_an_overlay_follows_the_working_tree_and_keeps_its_own(repository: Path) -> None:
    folder = overlay(repository, "smoke")
    assert folder == repository / ".profiles/smoke"
    assert read_yaml(folder / "params.yaml") == {
        "paint": {"strokes": 2, "rate": 1e-3},
        "report": {"size_px": 3},
    }
    assert (folder / "pipelines/paint.py").read_text() == "one\n"
    assert not (folder / "data").exists()
    assert not (folder / "dvc.lock").exists()
    assert str(repository / ".dvc/cache") in (folder / ".dvc/config.local").read_text()

    (folder / "dvc.lock").write_text("its own\n")
    (folder / "data").mkdir()
    (repository / "pipelines/paint.py").write_text("changed\n")
    (repository / "pipelines/new.py").write_text("not added yet\n")
    (repository / "pipelines/old.py").unlink()
    overlay(repository, "smoke")
    assert (folder / "pipelines/paint.py").read_text() == "changed\n"
    assert (folder / "pipelines/new.py").is_file()
    assert not (folder / "pipelines/old.py").exists()
    assert (folder / "dvc.lock").read_text() == "its own\n"
    assert (folder / "data").is_dir()


def test_an_overlay_leaves_the_working_tree_clean(repository: Path) -> None:
    status = ["git", "status", "--porcelain"]
    before = subprocess.run(status, cwd=repository, capture_output=True, check=True).stdout
    overlay(repository, "smoke")
    assert subprocess.run(status, cwd=repository, capture_output=True, check=True).stdout == before


def test_an_unknown_profile_is_one_sentence(
    repository: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(repository)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "unused")
    monkeypatch.setenv("PENTIMENTO_PROFILE", "unused")
    assert main(["nope"]) == 1
    assert capsys.readouterr().err == "make repro: there is no profile 'nope'; known are smoke.\n"


def test_outside_a_clone_an_overlay_is_refused(repository: Path) -> None:
    (repository / ".git").rename(repository / "no-git")
    with pytest.raises(PentimentoError, match="run in a git clone"):
        overlay(repository, "smoke")


def test_outputs_that_a_failure_left_missing_come_back(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """DVC removes a stage's outputs before it runs; the ones that are there must stay as they are."""
    asked: list[tuple[list[str], Path]] = []
    monkeypatch.setattr("pipelines._repro.run_dvc", lambda arguments, folder: asked.append((arguments, folder)))
    (repository / "dvc.yaml").write_text("stages: {paint: {cmd: x}, collect: {cmd: x}}\n")
    (repository / "dvc.lock").write_text(
        """stages:
  paint@colour: {outs: [{path: data/paintings/colour}]}
  collect: {outs: [{path: data/strokes}]}
  removed: {outs: [{path: data/removed}]}
  silent: {cmd: x}
"""
    )
    restore_missing(repository)
    assert asked == [(["checkout", "--quiet", "--allow-missing", "data/paintings/colour"], repository)]
    (repository / "dvc.lock").unlink()
    restore_missing(repository)
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("status", "ran", "closed"),
    [(0, True, "FINISHED"), (0, False, None), (1, False, "FAILED"), (130, True, "KILLED"), (143, False, "KILLED")],
)
def test_an_execution_is_named_for_its_stages_and_closed(
    repository: Path, monkeypatch: pytest.MonkeyPatch, status: int, ran: bool, closed: str | None
) -> None:
    """Where nothing was out of date there is nothing to close, and MLflow is not even opened."""
    named: list[str] = []
    ended: list[tuple[Path, str, str, frozenset[str]]] = []

    def dvc(folder: Path, _view: View, _targets: list[str]) -> Outcome:
        named.append(os.environ[VARIABLE])
        if ran:
            (folder / "data/timings").mkdir(parents=True, exist_ok=True)
            (folder / "data/timings/paint.json").write_text("{}")
        return Outcome(status, frozenset({"report"}) if status else frozenset())

    monkeypatch.chdir(repository)
    for name in ("MLFLOW_TRACKING_URI", "PENTIMENTO_PROFILE", VARIABLE):
        monkeypatch.setenv(name, "unused")
    monkeypatch.setattr("pipelines._repro.bring_up_to_date", dvc)
    monkeypatch.setattr("pipelines._repro.link", lambda *told: ended.append(told) or {})
    assert main(["smoke"]) == status
    assert named[0].startswith("smoke · 20")
    unfinished = {"report"} if status else set()
    assert ended == ([(repository / ".profiles/smoke", named[0], closed, unfinished)] if closed else [])
