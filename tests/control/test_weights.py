"""`pentimento run --weights`: the objectives of a plan, and the words that are weighed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pentimento.cli.main import main
from pentimento.contracts.images import write_png
from pentimento.control.commission import Weights, read_commission
from pentimento.control.turn import Turn, words_in, write_turn
from pentimento.planning.strokes.config import PRINT_ALONE, TextConfig
from tests.bundle.line_brush import paint_context
from tests.control.painting_bundle import small_vocabulary, write_painting_bundle

Array = NDArray[np.float32]


class Darkness:
    """A meaning in closed form: words are met by a black canvas, a target by one as dark as it is on average."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.targets = 0

    def text(self, words: str, _shape: tuple[int, int]) -> "Darkness.To":
        self.words.append(words)
        return Darkness.To(0.0)

    def semantic(self, target: Array) -> "Darkness.To":
        self.targets += 1
        return Darkness.To(float(target.mean()))

    class To:
        def __init__(self, mean: float) -> None:
            self.mean = mean

        def __call__(self, image: Array) -> tuple[float, Array]:
            apart = float(image.mean()) - self.mean
            return apart**2, np.full_like(image, 2 * apart / image.size)


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_painting_bundle(tmp_path_factory.mktemp("bundle"), replace(small_vocabulary(), by_window=True))


@pytest.fixture
def meaning(monkeypatch: pytest.MonkeyPatch) -> Darkness:
    seen = Darkness()
    monkeypatch.setattr("pentimento.control.run.GraphMeaning", lambda *_: seen)
    return seen


def test_weights_are_those_of_the_words_asked_for_last() -> None:
    context = replace(paint_context(), weights=Weights(print=0.5, semantic=0.2, text=0.1))
    assert context.about("a cat").planner.objectives == replace(
        PRINT_ALONE, print_weight=0.5, semantic_weight=0.2, text=TextConfig(0.1, "a cat")
    )
    assert context.about("").planner.objectives.text is None
    only_words = replace(context, weights=Weights(print=0.0, semantic=0.0, text=1.0))
    assert only_words.about("a cat").planner.objectives.print_weight == 0
    assert only_words.about("").planner.objectives == PRINT_ALONE  # nothing else says what to paint
    assert paint_context().about("a cat").planner.objectives == PRINT_ALONE


def test_words_of_a_painting_are_those_of_its_last_wish(tmp_path: Path) -> None:
    (tmp_path / "turns").mkdir()
    assert words_in(tmp_path) == ""
    write_turn(tmp_path, Turn(0, "a poodle", 0, 0))
    write_turn(tmp_path, Turn(1, "", 4, 0))
    assert words_in(tmp_path) == "a poodle"


def test_run_weighs_taught_words_at_first_and_after_a_new_wish(bundle: Path, tmp_path: Path, meaning: Darkness) -> None:
    out = tmp_path / "out"
    given = ["run", str(bundle), "--goal-text", "a poodle", "--weights", "print=1, semantic=0.2,text=0.1"]
    assert main([*given, "--out", str(out), "--strokes", "3", "--seed", "5"]) == 0
    assert read_commission(out).weights == Weights(print=1.0, semantic=0.2, text=0.1)
    assert set(meaning.words) == {"a dog"} and meaning.targets > 0
    meaning.words.clear()
    assert main(["run", "--resume", str(out), "--goal-text", "a cat"]) == 0
    assert meaning.words[-1] == "a cat"
    assert json.loads((out / "turns" / "001.json").read_text())["words"] == "a cat"


def test_run_refuses_the_weight_of_words_that_were_not_said(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(bundle), "--weights", "text=1", "--out", str(out)]) == 1
    assert "say with --goal-text what to paint" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("weights", "sentence"),
    [
        ("print", "give weights of print, semantic and text, such as print=1,semantic=0.3"),
        ("print=much", "give weights of print, semantic and text"),
        ("print=nan", "print"),
        ("print=-1", "print is -1.0; it must be 0 or more"),
        ("print=1,style=1", "style"),
        ("print=0", "print, semantic and text are 0"),
        ("text=1", "give --goal-text instead of a picture"),
    ],
)
def test_run_refuses_weights_in_a_sentence_and_creates_no_folder(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], weights: str, sentence: str
) -> None:
    write_png(tmp_path / "goal.png", np.full((8, 8, 3), 90, np.uint8))
    out, goal = tmp_path / "out", str(tmp_path / "goal.png")
    assert main(["run", str(bundle), "--goal-image", goal, "--weights", weights, "--out", str(out)]) == 1
    said = capsys.readouterr().err
    assert sentence in said and "Traceback" not in said
    assert not out.exists()
