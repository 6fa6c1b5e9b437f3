"""The extended model: the base where nothing extends it, the same after a round trip through its files."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from pentimento.contracts.covariates import PICKUP_COLUMNS
from pentimento.contracts.errors import ContractError
from pentimento.dynamics.strokes.evaluation import predict
from pentimento.dynamics.strokes.extended import (
    MeasuredStrokes,
    Span,
    StrokeModel,
    StrokeTiming,
    base_model,
    columns_read,
    model_files,
    painted,
    picks_up,
    predict_extended,
    predict_strokes,
    read_stroke_model,
    spans,
    timing_of,
)
from pentimento.dynamics.strokes.mechanisms import VOCABULARY
from pentimento.dynamics.strokes.mechanisms.canvas_tilt import CanvasTilt
from pentimento.dynamics.strokes.mechanisms.drying_shift import DryingShift
from pentimento.dynamics.strokes.mechanisms.ink_depletion import InkDepletion
from pentimento.dynamics.strokes.mechanisms.wet_mixing import WetMixing
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.simulation import Mechanism
from tests.dynamics.strokes.conftest import TRUTH


def observed(samples: StrokeSamples) -> MeasuredStrokes:
    """With columns for every mechanism."""
    rows = torch.arange(len(samples.path), dtype=torch.float32)
    return MeasuredStrokes(
        samples,
        {
            "ink_since_reload_m": 0.02 * (rows % 4),
            "since_reload": rows % 4,
            "t_start_s": 10.0 * rows,
            "t_before_s": 10.0 * rows - torch.where(rows % 4 == 0, 8.0, 3.0),
            "wet_age_s": torch.where(rows % 3 == 0, 20.0 + rows, torch.nan),
            "carried_share": 0.3 * (rows % 3),
            "carried_red": 0.1 * (rows % 7),
            "carried_green": 0.05 * (rows % 5),
            "carried_blue": 0.2 * (rows % 4),
            "humidity": 0.4 + 0.01 * (rows % 5),
            "tool_age_m": 0.02 * rows,
        },
    )


def changed(kind: type[Mechanism], strokes: MeasuredStrokes) -> Mechanism:
    """At half of what is typical."""
    typical = torch.tensor([quantity.typical for quantity in kind.quantities])
    return kind(0.5 * typical, kind.reference_of(strokes.context))


@pytest.fixture(scope="module")
def over_paint(made_by_truth: StrokeSamples) -> StrokeSamples:
    """The same strokes across a green stripe."""
    before = made_by_truth.before_linear.clone()
    before[:, 15:20] = torch.tensor([0.1, 0.5, 0.1])
    return made_by_truth._replace(before_linear=before)


def stored(model: StrokeModel, folder: Path) -> Path:
    for name, content in model_files(model).items():
        (folder / name).write_text(json.dumps(content))
    return folder


def test_without_causes_it_is_the_base_bit_by_bit(made_by_truth: StrokeSamples) -> None:
    model = base_model(TRUTH)
    predicted = predict_extended(model.mark(), model.mechanisms, observed(made_by_truth))
    assert torch.equal(predicted, predict(model.mark(), made_by_truth))


@pytest.mark.parametrize("kind", VOCABULARY, ids=lambda kind: kind.cause)
def test_a_cause_survives_its_file(kind: type[Mechanism], over_paint: StrokeSamples, tmp_path: Path) -> None:
    strokes = observed(over_paint)
    mechanism = changed(kind, strokes)
    names = columns_read([mechanism], strokes)
    model = StrokeModel(TRUTH, (mechanism,), spans(names, strokes), StrokeTiming(3.0, 5.0))
    again = read_stroke_model(stored(model, tmp_path))
    assert (again.parameters, again.fitted, again.timing) == (model.parameters, model.fitted, model.timing)
    (found,) = again.mechanisms
    assert type(found) is kind and found.reference == mechanism.reference
    predicted = predict_extended(model.mark(), [mechanism], strokes)
    assert torch.equal(predict_extended(again.mark(), again.mechanisms, strokes), predicted)
    assert not torch.equal(predicted, predict(model.mark(), over_paint))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("cause", lambda entry: entry | {"cause": "moonlight"}),
        ("unit", lambda entry: entry | {"values": {q: v | {"unit": "mm"} for q, v in entry["values"].items()}}),
        ("quantity", lambda entry: entry | {"values": {}}),
        ("number", lambda entry: entry | {"reference": {"column": 0.0, "since": None}}),
    ],
)
def test_what_is_no_cause_of_the_vocabulary_is_refused(
    name: str, change: Any, made_by_truth: StrokeSamples, tmp_path: Path
) -> None:
    mechanism = changed(InkDepletion, observed(made_by_truth))
    stored(StrokeModel(TRUTH, (mechanism,), {}, StrokeTiming(0.0, 0.0)), tmp_path)
    file = tmp_path / "mechanisms.json"
    content = json.loads(file.read_text())
    file.write_text(json.dumps(content | {"mechanisms": [change(entry) for entry in content["mechanisms"]]}))
    with pytest.raises(ContractError, match="make it with the stage diagnose_gap"):
        read_stroke_model(tmp_path)


def test_a_folder_of_a_base_alone_is_refused(tmp_path: Path) -> None:
    (tmp_path / "parameters.json").write_text(json.dumps(model_files(base_model(TRUTH))["parameters.json"]))
    with pytest.raises(ContractError, match=r"mechanisms\.json"):
        read_stroke_model(tmp_path)


def test_only_what_a_mechanism_reads_is_spanned(made_by_truth: StrokeSamples) -> None:
    strokes = observed(made_by_truth)
    read = {
        kind: columns_read([changed(kind, strokes)], strokes)
        for kind in (InkDepletion, DryingShift, WetMixing, CanvasTilt)
    }
    assert read == {
        InkDepletion: ["ink_since_reload_m"], DryingShift: ["t_start_s"],
        WetMixing: sorted((*PICKUP_COLUMNS, "wet_age_s")),
        CanvasTilt: [],
    }  # fmt: skip
    assert spans(["wet_age_s"], strokes)["wet_age_s"] == Span(20.0, 30.5, 41.0)  # of what is known


def test_only_wet_mixing_picks_up(made_by_truth: StrokeSamples) -> None:
    strokes, color = observed(made_by_truth), torch.zeros(len(made_by_truth.path), 1, 3)
    picking = [kind for kind in VOCABULARY if picks_up([changed(kind, strokes)], color, strokes.context)]
    assert picking == [WetMixing]


def test_paper_is_not_painted_and_paint_is() -> None:
    before = torch.full((1, 20, 20, 3), 0.9)
    before[0, :4, :5] = torch.tensor([0.1, 0.5, 0.1])
    assert torch.equal(painted(before)[0, :4, :5], torch.ones(4, 5))
    assert float(painted(before).sum()) == 20


def test_the_pace_is_read_off_the_clock(made_by_truth: StrokeSamples) -> None:
    columns = observed(made_by_truth).covariates
    assert timing_of(columns) == StrokeTiming(3.0, 5.0)
    assert timing_of({name: v for name, v in columns.items() if name != "t_before_s"}) == StrokeTiming(0.0, 0.0)


def test_covariates_beyond_the_fitted_range_are_held_at_its_end(made_by_truth: StrokeSamples) -> None:
    strokes = observed(made_by_truth)
    fading = changed(InkDepletion, strokes)
    model = StrokeModel(TRUTH, (fading,), {"ink_since_reload_m": Span(0.0, 0.02, 0.04)}, StrokeTiming(0.0, 0.0))
    far, end = (
        strokes._replace(covariates={"ink_since_reload_m": torch.full((len(made_by_truth.path),), used)})
        for used in (5.0, 0.04)
    )
    assert torch.equal(predict_strokes(model, far), predict_strokes(model, end))
