"""A push model on the canvas and in files."""

from pathlib import Path

import pytest
import torch

from pentimento.contracts.errors import ConfigError
from pentimento.dynamics.pushes.evaluation import predict
from pentimento.dynamics.pushes.push_model import read_push_model, write_push_model
from tests.dynamics.pushes.conftest import Trained


def test_what_is_written_is_read_again(trained: Trained, tmp_path: Path) -> None:
    write_push_model(trained.model, tmp_path)
    again = read_push_model(tmp_path)
    assert again.facts == trained.model.facts
    assert torch.equal(predict(again, trained.held_out), predict(trained.model, trained.held_out))


def test_the_same_model_is_written_in_the_same_bytes(trained: Trained, tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        write_push_model(trained.model, tmp_path / name)
    for file in ("config.json", "weights.safetensors"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes()


def test_a_folder_without_a_model_is_a_sentence(trained: Trained, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no push model"):
        read_push_model(tmp_path)
    write_push_model(trained.model, tmp_path)
    config = tmp_path / "config.json"
    config.write_text(config.read_text().replace('"members": 2', '"members": 3'))
    with pytest.raises(ConfigError, match="holds no push model"):
        read_push_model(tmp_path)


def test_nothing_changes_outside_the_crop(trained: Trained) -> None:
    before = torch.full((1, 60, 60), 0.04)
    action = torch.tensor([[0.03, 0.03, 0.0, 0.02, 0.006]])
    change = trained.model.after(before, torch.tensor([[0.0, 0.0, 0.12, 0.12]]), action)[0] - before[0]
    assert (change[:25, 45:] == 0).all()  # the upper right corner is beyond the crop
    assert change.min() < -1e-3
