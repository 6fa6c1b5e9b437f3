"""Two executions whose difference is known, compared by the command: what it says, and what it refuses."""

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest

from pentimento.contracts.errors import PentimentoError
from pipelines import compare
from pipelines._dvc import run_dvc
from pipelines._review.agreement import altered, check
from pipelines._review.comparison import Comparison, Side, StageDifference
from pipelines._review.comparison import compare as compare_runs
from pipelines._review.history import Execution, History, StageRun
from pipelines._review.page import text
from pipelines._tracking.store import open_store, store_errors
from pipelines.compare import last_two
from tests.pipelines.conftest import Enter
from tests.pipelines.history import digest_of, execute, repository
from tests.pipelines.test_side_by_side import pipeline

BOTH = ("train_stroke_dynamics", "paint")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, enter: Enter) -> Iterator[Path]:
    """Executions `first` (both stages), `second` (training alone, better beyond luck), `third` (nothing but luck)."""
    folder = tmp_path_factory.mktemp("repository")
    with pytest.MonkeyPatch.context() as patch:
        enter(folder, patch)
        repository(folder)
        execute("first", 4, 0.30, patch, BOTH)
        execute("second", 8, 0.20, patch, BOTH[:1])
        execute("third", 9, 0.20, patch, BOTH[:1])
        patch.delenv("PENTIMENTO_EXECUTION")
        yield folder


def ask(*words: object) -> None:
    """What `python -m pipelines.compare` does with these words."""
    compare.main(compare.command_line().parse_args([str(word) for word in words]))


def test_executions_are_compared_stage_by_stage(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ask("first", "second")
    said = capsys.readouterr().out
    assert "1 parameter differs: train_stroke_dynamics@marker: epochs." in said
    assert "epochs: 4 -> 8" in said
    assert "train_stroke_dynamics@marker: B is better; beyond luck: B − A = −0." in said
    assert "paired over 20 held-out items" in said
    assert "The same in both: paint." in said  # the second found it done
    assert "models/stroke_marker_base/weights" in said
    assert "\n    data/strokes: Made by the robot in the studio. 108 rows; licence not recorded\n" in said
    page = next(Path("data/comparisons").glob("*.html")).read_text()
    assert "http" not in page.replace("http-equiv", "")  # it needs nothing else
    assert page.count("data:image/png;base64,") == 3  # both, and where they differ
    assert page.count("Made by the robot in the studio. 108 rows") == 2  # of A and of B
    assert page.index("What changed") < page.index("is it luck") < page.index('id="train-stroke-dynamics-marker"')
    assert "figures are equal" in page


def test_luck_is_called_luck_and_the_last_two_are_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ask("--last", 2)
    said = capsys.readouterr().out
    assert said.startswith("A  second") and "\nB  third" in said
    assert "may be luck: B − A" in said


def test_the_last_two_are_of_one_profile() -> None:
    """A run in small stands between two whole ones; only where there is no other is it compared with one."""
    whole, small, again = (
        Execution(name, ("0",), "FINISHED", 0, {"profile": profile})
        for name, profile in (("whole", "default"), ("small", "smoke"), ("again", "default"))
    )
    assert last_two([again, small, whole]) == (whole, again)
    assert last_two([small, whole]) == (whole, small)


def test_single_runs_are_compared_by_the_first_letters_of_their_ids(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with store_errors():
        newest, _, oldest = [run for run in History().runs if run.stage == "train_stroke_dynamics"]
    ask(oldest.id[:12], newest.id[:12])
    by_id = capsys.readouterr().out
    assert "train_stroke_dynamics@marker: B is better; beyond luck" in by_id
    ask("--last", 2, "--stage", "train_stroke_dynamics@marker")
    assert "may be luck" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("first", "Two runs are compared and the command names 1;"),
        ("first nothing", "No run or execution is called 'nothing'.*'third', 'second', 'first'"),
        ("first --last 2", "--last takes the number 2 and no other runs"),
        ("--last 2 --stage paint", "Two finished runs of paint are compared and MLflow's store has 1;"),
        ("--last 2 --stage train_stroke_dynamics@markr", "it has runs of train_stroke_dynamics@marker."),
        ("--last 2 --stage pain", "no run of 'pain'; it has runs of paint."),
    ],
)
def test_what_cannot_be_compared_is_one_sentence(folder: Path, words: str, sentence: str) -> None:
    with pytest.raises(PentimentoError, match=sentence):
        ask(*words.split())


def test_a_name_of_several_runs_names_none(folder: Path) -> None:
    with pytest.raises(PentimentoError, match="may be any of 3 runs"):
        ask("first", "train_stroke_dynamics · marker")


def test_executions_are_parents_that_carry_the_main_figures_and_what_stood(folder: Path) -> None:
    with store_errors():
        client, history = open_store(), History()
    third, second, first = history.executions
    assert [each.name for each in (first, second, third)] == ["first", "second", "third"]
    assert (len(first.ids), len(second.ids)) == (2, 1)  # families
    assert set(second.reused) == {"paint"}
    parents = {parent: client.get_run(parent) for parent in first.ids}
    (strokes,) = (run for run in parents.values() if run.data.tags["family"] == "strokes")
    assert strokes.info.status == "FINISHED"
    assert strokes.data.metrics["train_stroke_dynamics/marker/held_out.polyline.mse"] == 0.4
    (run,) = (run for run in history.runs if run.tags["execution"] == "second")
    assert run.tags["mlflow.parentRunId"] == second.ids[0]
    assert (run.tags["tool"], run.tags["profile"], run.tags["kind"]) == ("marker", "default", "stage")
    assert run.tags["output:models/stroke_marker_base/weights"] == digest_of(0.20)
    note = run.tags["mlflow.note.content"]
    assert note.startswith("Train Traj2Stroke") and "beside 0.4 of `held_out.polyline.mse`" in note
    assert "| held_out | model | polyline |" in note


def test_mlflow_and_dvc_agree_until_one_of_them_is_changed(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    files: dict[str, str] = {}  # this dvc.lock is too short for DVC itself
    monkeypatch.setattr(compare, "altered", lambda _folder: files)
    ask("--check")
    assert capsys.readouterr().out == "MLflow and dvc.lock agree on all 2 stage items.\n"
    ask("--check", "--stage", "paint")
    (run,) = (run for run in History().of_execution(History().executions[0]).values() if run.name == "paint")
    said = capsys.readouterr().out.splitlines()
    assert said[0] == f"paint: written by the run {run.id}, and not changed since." and "all 1 stage" in said[1]
    lock = Path("dvc.lock").read_text()
    strokes = History().runs[0].inputs["data/strokes"]
    try:
        for old, new, sentence in (
            ("epochs: 9", "epochs: 10", "ran with other parameters than dvc.lock has in section train_stroke_dynamics"),
            (strokes, "f" * 32, "read another data/strokes"),
            (digest_of(0.20), "f" * 32, "wrote another models/stroke_marker_base/weights"),
        ):
            assert old in lock
            Path("dvc.lock").write_text(lock.replace(old, new))
            agreeing, (said,) = check(folder, "default")
            assert len(agreeing) == 1 and said.startswith("train_stroke_dynamics@marker: ") and sentence in said
        files["paint"] = "paint: data/paintings is not what dvc.lock has."
        with pytest.raises(PentimentoError, match=r"disagree on 1 of 2 stage items.* Files of 1 of the stage items"):
            ask("--check")
        assert capsys.readouterr().out.endswith(f"{files['paint']}\n")
    finally:
        Path("dvc.lock").write_text(lock)


def test_results_that_dvc_brought_back_agree_with_the_earlier_run(folder: Path) -> None:
    """DVC restores what it computed before without running the stage: the lock is then that of an older run."""
    lock = Path("dvc.lock").read_text()
    try:
        Path("dvc.lock").write_text(lock.replace("epochs: 9", "epochs: 4").replace(digest_of(0.20), digest_of(0.30)))
        agreeing, said = check(folder, "default")
        assert len(agreeing) == 2 and not said
    finally:
        Path("dvc.lock").write_text(lock)


def test_an_altered_file_is_named(tmp_path: Path) -> None:
    folder = pipeline(tmp_path, "  one: {cmd: mkdir m && touch m/weights m/rows s, outs: [m, s]}")
    assert run_dvc(["repro", "--quiet"], folder) == 0
    assert altered(folder) == {}
    (folder / "m/weights").unlink()
    (folder / "m/weights").write_text("other")
    (folder / "s").unlink()
    said = "one: m is not what dvc.lock has (m/weights modified); s is not what dvc.lock has."
    assert altered(folder) == {"one": said}
    (folder / "dvc.yaml").write_text("stages: [")
    with pytest.raises(PentimentoError, match="DVC cannot compare the files"):
        altered(folder)


def test_a_stage_that_an_interrupted_execution_did_not_reach_is_not_called_the_same() -> None:
    def run(id_: str, status: str) -> StageRun:
        return StageRun(id_, "paint", "", status, 0, {}, {}, {}, {}, {})

    def words(b: StageRun | None) -> str:
        sides = [Side(name, 0, status, "", False, "", {}) for name, status in (("A", "FINISHED"), ("B", "KILLED"))]
        runs = (run("1", "FINISHED"), b)
        stage = StageDifference("paint", runs, {}, {}, {}, (), (None, None), ({}, {}))
        return text(Comparison((sides[0], sides[1]), (stage,)))

    assert "paint: not reached in B" in words(None)
    assert "paint: did not finish in B (killed)" in words(run("2", "KILLED"))
    assert "The same in both: paint." in words(run("2", "FINISHED"))


def test_a_stage_that_never_ran_is_missing(folder: Path) -> None:
    with pytest.raises(PentimentoError, match=r"smoke has no dvc.lock.* another profile: `--profile default`"):
        ask("--check", "--profile", "smoke")
    agreeing, said = check(folder, "smoke")
    assert not agreeing and len(said) == 2 and all("MLflow has no finished run of it" in each for each in said)


@pytest.mark.parametrize(
    ("stage", "item", "changed", "sentence"),
    [
        ("paint", "colour", "photograph", "differs; not comparable: the runs have different tasks (photograph)"),
        ("sculpt", "foam", "settings.foam.goals", "differs; not comparable: the runs have different tasks (goals)"),
        ("sculpt", "foam", "settings.dough.goals", "B is better"),
        ("paint", "colour", "strokes", "B is better"),
    ],
)
def test_runs_of_different_tasks_have_no_better_side(
    stage: str, item: str, changed: str, sentence: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(id_: str, value: str, error: float) -> StageRun:
        return StageRun(id_, stage, item, "FINISHED", 0, {changed: value}, {"error": error}, {}, {}, {})

    monkeypatch.setattr(History, "pictures", lambda _history, _run: {})
    with store_errors():
        (difference,) = compare_runs(History(), run("1", "coffee", 0.3), run("2", "cat", 0.2)).stages
    (figure,) = difference.figures
    assert figure.sentence.startswith(sentence)
    assert (figure.better == "B") == (sentence == "B is better")


def test_every_metric_of_the_last_execution_is_in_one_table(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask("--metrics", tmp_path / "new/metrics.csv")
    with (tmp_path / "new/metrics.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    runs = History().of_execution(History().executions[0])
    assert {(row["stage"], row["run"]) for row in rows} == {(name, run.id) for name, run in runs.items()}
    assert {row["metric"]: float(row["value"]) for row in rows if row["stage"] == "paint"} == runs["paint"].metrics
    assert capsys.readouterr().out.startswith(f"{len(rows)} metrics of 2 stage runs are in ")
    with pytest.raises(PentimentoError, match="the command names 2"):
        ask("first", "second", "--metrics", tmp_path / "metrics.csv")
