"""Tests of the learning curve of the stroke model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pentimento.cli.main import main
from pentimento.contracts.strokes import example_table
from pentimento.dynamics.strokes import learning_curve
from pentimento.dynamics.strokes.learning_curve import Gain, LearningCurve, _counts, _gain


def curve(*gains: Gain) -> LearningCurve:
    strokes = tuple(10 * 2**at for at in range(len(gains) + 1))
    return LearningCurve(strokes, strokes, (0.01,) * len(strokes), 0.02, gains, 20)


SMALL, LARGE, UNSURE = Gain(0.01, -0.01, 0.03), Gain(0.2, 0.1, 0.3), Gain(0.04, -0.05, 0.12)
RISE = Gain(-2.7, -3.2, -2.3)  # beyond its interval: a fit that failed


@pytest.mark.parametrize(
    ("gains", "enough", "says"),
    [
        ((LARGE, SMALL), 20, "20 strokes are enough"),
        ((LARGE, SMALL, SMALL), 20, "20 strokes are enough"),
        ((SMALL, LARGE), None, "More strokes make a better model"),
        ((SMALL, UNSURE), None, "Undecided"),
        ((SMALL, LARGE, SMALL), 40, "40 strokes are enough"),
        (
            (RISE, LARGE, SMALL),
            None,
            "from 10 to 20 strokes the error rises by 270.0 % (95 %: 230.0 % to 320.0 %)",
        ),
        ((SMALL, LARGE, RISE), None, "Unsure: from 40 to 80 strokes"),
    ],
)
def test_learning_curve_is_enough_after_the_last_doubling_with_a_gain(
    gains: tuple[Gain, ...], enough: int | None, says: str
) -> None:
    assert curve(*gains).enough == enough and says in curve(*gains).sentence


def test_gain_is_paired_over_actions() -> None:
    before = np.random.default_rng(0).lognormal(0, 1, 50)
    gain = _gain(before, 0.9 * before, 0)
    assert gain == pytest.approx((0.1, 0.1, 0.1))  # every action gains as much, however they differ
    none = _gain(before, np.random.default_rng(1).permutation(before), 0)
    assert none.value == pytest.approx(0) and none.low < -0.1 and none.high > 0.1


def test_shares_double_and_have_enough_actions() -> None:
    assert _counts(66) == [8, 16, 33, 66] and _counts(40) == [10, 20, 40] and _counts(9) == [9]


def test_command_prints_the_curve_and_the_error_of_a_blank_prediction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quick = replace(learning_curve._TRAINING, pixels_per_m=500.0, path_points=16, epochs=15)
    monkeypatch.setattr(learning_curve, "_TRAINING", quick)
    monkeypatch.setattr(learning_curve, "_MIN_STEPS", 30)
    pq.write_table(example_table(32), tmp_path / "rows.parquet")
    assert main(["enough", str(tmp_path / "rows.parquet")]) == 0
    sampling, *lines, advice = capsys.readouterr().out.splitlines()
    assert "compared at 0.5 px/mm" in sampling
    errors = [float(line.split()[2]) for line in lines[1:-2]]
    blank = float(lines[-2].split()[1])
    assert len(errors) == 2 and max(errors) < 0.3 * blank
    assert "95 %" in lines[-1] and "a diagnosis wants at least a hundred" in advice


def test_rejects_too_few_actions_for_a_curve(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pq.write_table(example_table(16), tmp_path / "rows.parquet")
    assert main(["enough", str(tmp_path / "rows.parquet")]) == 1
    assert "record more strokes" in capsys.readouterr().err
