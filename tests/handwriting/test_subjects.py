"""Named things in writers' styles: their choice and targets, and what is recognised in their drawings."""

import numpy as np
import pytest

import pentimento.handwriting.subjects as subjects
from pentimento.contracts.errors import ConfigError
from pentimento.copainting.drawings.sources import vocabulary
from pentimento.handwriting.evaluation import StrokeClassifier
from pentimento.handwriting.subjects import (
    DrawnSubject,
    Grid,
    choose_subjects,
    contact_sheet,
    recognition,
    shown,
    subject_on,
)

SHEET = np.full((60, 60, 3), 0.9, np.float32)
LINE, CIRCLE = (
    np.column_stack([np.linspace(0, 0.02, 20), np.zeros(20)]),
    0.005 * np.column_stack([np.cos(np.linspace(0, 6, 20)), np.sin(np.linspace(0, 6, 20))]),
)


@pytest.mark.parametrize("with_ink", [True, False])
def test_target_is_the_sheet_around_a_centred_thing(with_ink: bool) -> None:
    target = subject_on(SHEET, "house", with_ink=with_ink)
    np.testing.assert_array_equal(target[:3], SHEET[:3])
    changed = np.abs(target - SHEET).max(-1) > 0.2
    rows, columns = np.nonzero(changed)
    assert max(np.ptp(rows), np.ptp(columns)) == pytest.approx(0.875 * 60, abs=3)
    assert columns.mean() == pytest.approx(29.5, abs=5)
    if with_ink:
        assert (target <= SHEET).all() and np.ptp(target, axis=-1).max() < 1e-6


def pretend_judge(monkeypatch: pytest.MonkeyPatch, answers: list[str]) -> None:
    """Let the judge answer with these names, picture by picture, again and again."""
    monkeypatch.setattr(
        subjects, "name_pictures", lambda _judge, pictures: [answers[i % len(answers)] for i in range(len(pictures))]
    )


def test_subjects_are_the_first_that_the_judge_names_right(monkeypatch: pytest.MonkeyPatch) -> None:
    few = dict(list(vocabulary().items())[:8])
    monkeypatch.setattr(subjects, "vocabulary", lambda: few)
    order = [str(name) for name in np.random.default_rng([3, 31]).permutation(list(few))]
    pretend_judge(monkeypatch, ["nothing", order[1], "nothing", *order[3:]])
    chosen, known = choose_subjects(3, SHEET, None, with_ink=True, seed=3)  # type: ignore[arg-type]
    assert chosen == [order[1], order[3], order[4]]
    assert known == pytest.approx((len(order) - 2) / len(order))
    pretend_judge(monkeypatch, ["nothing"])
    with pytest.raises(ConfigError, match="names 0 of 8 things right and 3 subjects are asked for"):
        choose_subjects(3, SHEET, None, with_ink=True, seed=3)  # type: ignore[arg-type]


def test_recognition_counts_things_and_writers(monkeypatch: pytest.MonkeyPatch) -> None:
    scaled = [scale * path for path in (LINE, CIRCLE) for scale in np.linspace(0.9, 1.1, 12)]
    who = StrokeClassifier(scaled, ["liner"] * 12 + ["circler"] * 12, 0)
    blank = shown(SHEET)

    def drawn(*paths: np.ndarray) -> DrawnSubject:
        return DrawnSubject(len(paths), list(paths), blank)

    own = {"cat": drawn(LINE, LINE), "sun": drawn(LINE, LINE, CIRCLE)}
    foreign = {"cat": drawn(LINE), "sun": drawn(CIRCLE, CIRCLE, LINE, CIRCLE)}
    grid = Grid({"cat": blank, "sun": blank}, blank, 0.6, {"liner": own, "circler": foreign, "bezier": own})
    pretend_judge(monkeypatch, ["cat", "egg"])
    found = recognition(grid, None, who)  # type: ignore[arg-type]
    assert found["named_right"] == dict.fromkeys(("liner", "circler", "bezier", "target", "blank"), 0.5)
    assert found["subjects_named_right"] == 0.5
    assert found["own_strokes"] == pytest.approx(((1 + 2 / 3) / 2 + (0 + 3 / 4) / 2) / 2)
    assert found["own_drawings"] == 0.75
    assert found["drawings_of"]["circler"] == {"liner": 1, "circler": 1}
    assert found["strokes"]["circler"] == 2.5
    sheet = contact_sheet(grid, {"liner": [LINE], "circler": []}, 0.24)
    assert sheet.shape == (3 * 240, 4 * 240, 3)
    assert sheet[:240, 240:480].min() < 100 < sheet[:240, 480:].min()
