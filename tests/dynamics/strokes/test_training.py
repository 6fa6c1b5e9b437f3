"""Training finds the parameters that made the strokes, and beats what is trivial."""

import dataclasses

import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.strokes.evaluation import (
    blank,
    fit_polyline,
    mean_squared_error,
    predict_with,
    score,
    score_model,
    weighted_l1,
)
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.training import TrainingConfig, first_guess, split_by_action, train
from tests.dynamics.strokes.conftest import TRUTH

CONFIG = TrainingConfig(12, 1000.0, 0.05, 40, 8, 0.05, 2.0, 0.25, 0)


def test_the_truth_is_found_again(made_by_truth: StrokeSamples) -> None:
    curve: list[float] = []
    found = train(made_by_truth, CONFIG, lambda name, value, step: curve.append(value)).parameters_si()
    assert curve[-1] < 0.3 * curve[0]
    assert found.scale == pytest.approx(TRUTH.scale, abs=0.02)
    assert found.offset_m == pytest.approx(TRUTH.offset_m, abs=1e-4)
    assert found.thickness_per_press == pytest.approx(TRUTH.thickness_per_press, rel=0.1)
    assert found.thickness_at_contact_m == pytest.approx(TRUTH.thickness_at_contact_m, rel=0.1)
    assert found.softness == pytest.approx(TRUTH.softness, abs=0.06)
    assert found.opacity == pytest.approx(TRUTH.opacity, abs=0.03)


def test_training_twice_gives_the_same_bits(made_by_truth: StrokeSamples) -> None:
    short = dataclasses.replace(CONFIG, epochs=2)
    first, second = (train(made_by_truth, short, lambda *_: None).state_dict() for _ in range(2))
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_the_order_truth_polyline_blank(made_by_truth: StrokeSamples) -> None:
    polyline = fit_polyline(lambda pen: mean_squared_error(predict_with(pen, made_by_truth), made_by_truth))
    scores = [
        score_model(TRUTH, made_by_truth),
        score_model(polyline, made_by_truth),
        score(blank(made_by_truth), made_by_truth),
    ]
    assert scores[0].mse < 1e-5  # eight bits a colour
    assert scores[0].mse < scores[1].mse < scores[2].mse
    assert scores[0].iou > 0.99 > scores[1].iou > scores[2].iou == 0


def test_repeats_of_an_action_stay_together(made_by_truth: StrokeSamples) -> None:
    paired = made_by_truth._replace(action=made_by_truth.action // 2)
    training, held_out = split_by_action(paired, 0.25, seed=3)
    assert len(held_out.path) == 6
    assert not set(training.action.tolist()) & set(held_out.action.tolist())


def test_held_out_actions_that_leave_none_to_train_on_are_a_sentence(made_by_truth: StrokeSamples) -> None:
    one_action = made_by_truth._replace(action=torch.zeros_like(made_by_truth.action))
    for samples, held_out in ((one_action, 0.25), (made_by_truth, 0.99)):
        with pytest.raises(ContractError, match=r"none trained on: .*held_out"):
            split_by_action(samples, held_out, seed=3)


def test_table_in_millimetres_raises_contract_error(made_by_truth: StrokeSamples) -> None:
    path = made_by_truth.path * torch.tensor([1.0, 1e3, 1e3, 1.0, 1.0])
    in_mm = made_by_truth._replace(path=path, pixels_per_m=made_by_truth.pixels_per_m / 1e3)
    with pytest.raises(ContractError, match="are in metres"):
        first_guess(in_mm)


def test_strokes_that_left_no_ink_are_a_sentence(made_by_truth: StrokeSamples) -> None:
    with pytest.raises(ContractError, match=r"None of the 18 training strokes left ink"):
        split_by_action(made_by_truth._replace(ink=torch.zeros_like(made_by_truth.ink)), 0.25, seed=3)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("epochs", 0), ("batch", 0), ("path_points", 1), ("pixels_per_m", 0.0), ("margin_m", 0.0), ("seed", -1),
        ("learning_rate", 0.0), ("ink_weight", -5.0), ("held_out", 0.0), ("held_out", 1.0),
    ],
)  # fmt: skip
def test_config_rejects_numbers_out_of_range(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"^{field} is {value}; "):
        dataclasses.replace(CONFIG, **{field: value})


def test_inked_pixels_weigh_more(made_by_truth: StrokeSamples) -> None:
    nothing = blank(made_by_truth)
    assert weighted_l1(nothing, made_by_truth, 5.0) > weighted_l1(nothing, made_by_truth, 1.0)
    assert float(weighted_l1(made_by_truth.after, made_by_truth, 5.0)) == 0
