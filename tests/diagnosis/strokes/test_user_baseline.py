"""Error of a user-supplied baseline model on the test split."""

from dataclasses import replace

import numpy as np
import pytest

from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes import report
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.out_of_distribution import UserBaseline, evaluate_baseline
from pentimento.diagnosis.strokes.report import build_page
from pentimento.diagnosis.verdict import verdict
from pentimento.dynamics.strokes.evaluation import predict_with, score_model
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
from tests.diagnosis.strokes.conftest import Written

PARAMETERS = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 0.001, 0.3, 0.9)


@pytest.fixture(scope="module")
def strokes() -> Measured:
    return load_measured(example_table(8))


def test_baseline_error_is_the_squared_difference(strokes: Measured) -> None:
    prediction = predict_with(PARAMETERS, strokes.samples)
    true = replace(strokes, samples=strokes.samples._replace(after=prediction))
    assert evaluate_baseline(PARAMETERS, true).mse == 0
    paler = replace(strokes, samples=strokes.samples._replace(after=prediction + 0.1))
    np.testing.assert_allclose(evaluate_baseline(PARAMETERS, paler).losses, 0.01, rtol=1e-4)


def test_repeats_of_an_action_count_once(strokes: Measured) -> None:
    thrice = strokes.pick(np.array([0, 1, 1, 1]))
    singly = evaluate_baseline(PARAMETERS, strokes.pick(np.array([0, 1]))).losses
    np.testing.assert_allclose(evaluate_baseline(PARAMETERS, thrice).losses, singly, rtol=1e-5)


def test_baseline_error_equals_the_training_metric(strokes: Measured) -> None:
    one = strokes.pick(np.array([2]))
    assert evaluate_baseline(PARAMETERS, one).mse == pytest.approx(score_model(PARAMETERS, one.samples).mse, rel=1e-4)


@pytest.fixture(scope="module")
def given(written: Written) -> UserBaseline:
    return evaluate_baseline(PARAMETERS, written.screening.test)


def test_verdict_adds_the_baseline_only(written: Written, given: UserBaseline) -> None:
    plain, beside = (verdict(written.result, given_mse=mse) for mse in (None, given.mse))
    assert beside["mse"].pop("given") == given.mse > beside["mse"]["base"]
    added = beside["text"].replace(plain["text"], "").strip()
    assert added.startswith("The given model has an error of") and "calibration" in added
    assert beside | {"text": ""} == plain | {"text": ""}
    better = verdict(written.result, given_mse=plain["mse"]["base"] / 2)
    assert "no more than the base" in better["text"]


def test_page_shows_baseline_predictions(written: Written, given: UserBaseline) -> None:
    content = verdict(written.result, given_mse=given.mse)
    pages = [
        build_page(written.result, written.screening, written.proposal, each, baseline)
        for each, baseline in ((verdict(written.result), None), (content, given))
    ]
    assert set(pages[1]) - set(pages[0]) == {"figures/given_strokes.png"}
    assert pages[1]["figures/leave_one_out.png"] != pages[0]["figures/leave_one_out.png"]
    assert pages[1]["figures/strokes.png"] == pages[0]["figures/strokes.png"]
    blank = given._replace(predicted=np.ones_like(given.predicted))
    drawn = report.given_strokes(blank, written.result, written.screening)
    assert drawn != pages[1]["figures/given_strokes.png"]
