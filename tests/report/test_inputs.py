import json
import shutil
from pathlib import Path

import pytest

from pentimento.contracts.errors import ContractError, ImageError
from pentimento.report.inputs import PaintingInputs, StrokePictures, ToolInputs, read_painting, read_tool
from tests.report.conftest import HELD_OUT, PICTURES


@pytest.fixture
def painting_copy(painting_folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(painting_folder, tmp_path / "colour"))


@pytest.fixture
def weights_copy(tool_folders: tuple[Path, Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(tool_folders[1], tmp_path / "weights"))


def test_only_held_out_strokes_are_read(tool: ToolInputs) -> None:
    assert set(tool.held_out.action.tolist()) == set(HELD_OUT)


def test_pictures_and_frames_are_read(painting: PaintingInputs) -> None:
    assert len(painting.frames) == 3 and painting.plan.shape == (40, 60, 3)
    assert len(painting.executed.strokes) == 3 and painting.palette_srgb.shape == (2, 3)


def test_a_missing_file_is_named(painting_copy: Path) -> None:
    (painting_copy / "deviation.json").unlink()
    with pytest.raises(ContractError, match=r"deviation\.json cannot be read .*make repro"):
        read_painting("colour", painting_copy)


def test_a_missing_picture_is_named(painting_copy: Path) -> None:
    (painting_copy / "plan.png").unlink()
    with pytest.raises(ImageError, match=r"plan\.png"):
        read_painting("colour", painting_copy)


def test_a_missing_entry_and_broken_json_are_sentences(painting_copy: Path) -> None:
    (painting_copy / "curve.json").write_text(json.dumps({"iteration": []}))
    with pytest.raises(ContractError, match=r"'objective'.* run the stage paint again"):
        read_painting("colour", painting_copy)
    (painting_copy / "curve.json").write_text("{")
    with pytest.raises(ContractError, match=r"curve\.json is not JSON"):
        read_painting("colour", painting_copy)


def test_a_painting_without_photographs_is_refused(painting_copy: Path) -> None:
    shutil.rmtree(painting_copy / "frames")
    with pytest.raises(ContractError, match="holds no photograph"):
        read_painting("colour", painting_copy)


def test_a_model_of_other_strokes_is_refused(tool_folders: tuple[Path, Path], weights_copy: Path) -> None:
    (weights_copy / "held_out_actions.json").write_text("[999]")
    with pytest.raises(ContractError, match="train the model on these strokes again"):
        read_tool("round_brush", tool_folders[0], weights_copy, PICTURES)


def test_missing_scores_are_named(tool_folders: tuple[Path, Path], weights_copy: Path) -> None:
    (weights_copy / "metrics.json").write_text("{}")
    with pytest.raises(ContractError, match=r"'held_out'.*train_stroke_dynamics"):
        read_tool("round_brush", tool_folders[0], weights_copy, PICTURES)


def test_at_least_one_stroke_is_shown() -> None:
    with pytest.raises(ValueError, match="at least one"):
        StrokePictures(shown=0, path_points=16, pixels_per_m=1000.0, margin_m=0.01)
    with pytest.raises(ValueError, match=r"path_points is 1; it must be 2 or more"):
        StrokePictures(shown=3, path_points=1, pixels_per_m=1000.0, margin_m=0.01)
