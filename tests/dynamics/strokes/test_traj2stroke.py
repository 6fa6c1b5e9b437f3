"""The seven parameters do what their names say."""

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke, Traj2StrokeParameters, read_parameters

IDENTITY = Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.5, 1e-3, 0.3, 0.9)
PATH = torch.tensor([[0.0, 0.01, 0.02, 0.0, 0.0], [0.5, 0.02, 0.03, -1e-3, 0.0], [1.0, 0.03, 0.02, 2e-3, 0.0]])


def test_the_identity_leaves_the_path_where_it_is() -> None:
    torch.testing.assert_close(Traj2Stroke(IDENTITY)(PATH).points_m, PATH[:, 1:3])


def test_scale_is_about_the_start_and_offset_shifts_all() -> None:
    mark = Traj2Stroke(replace(IDENTITY, scale=(0.5, 2.0), offset_m=(1e-3, -2e-3)))(PATH)
    expected = torch.tensor([[0.011, 0.018], [0.016, 0.038], [0.021, 0.018]])
    torch.testing.assert_close(mark.points_m, expected)


def test_thickness_is_affine_in_press_and_blind_to_lift() -> None:
    radius = Traj2Stroke(IDENTITY)(PATH).radius_m
    torch.testing.assert_close(radius, torch.tensor([1e-3, 1.5e-3, 1e-3]))


def test_parameters_survive_the_model_and_the_file(tmp_path: Path) -> None:
    found = Traj2Stroke(IDENTITY).parameters_si()
    for name, value in asdict(IDENTITY).items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-4), name
    file = tmp_path / "parameters.json"
    file.write_text(json.dumps(asdict(IDENTITY)))
    assert read_parameters(file) == IDENTITY


@pytest.mark.parametrize("text", ["", "[]", '{"scale": [1, 1]}'])
def test_a_file_that_is_no_model_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "parameters.json"
    file.write_text(text)
    with pytest.raises(ContractError, match="is not a stroke model"):
        read_parameters(file)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("softness", math.nan), ("thickness_per_press", math.inf), ("opacity", "soft"), ("opacity", None),
        ("softness", -1.0), ("thickness_per_press", -1.0), ("opacity", 2.0), ("scale", [1.0, math.nan]),
        ("offset_m", [0.0, 0.0, 0.0]),
    ],
)  # fmt: skip
def test_parameters_that_are_no_numbers_or_out_of_range_are_refused(tmp_path: Path, field: str, value: object) -> None:
    file = tmp_path / "parameters.json"
    file.write_text(json.dumps(asdict(IDENTITY) | {field: value}))
    with pytest.raises(ContractError, match="is not a stroke model"):
        read_parameters(file)
