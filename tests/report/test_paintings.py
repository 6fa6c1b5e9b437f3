import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pentimento.contracts.errors import ContractError, ImageError
from pentimento.report.html import Album
from pentimento.report.paintings import PaintingInputs, painting_section, read_painting, summary


@pytest.fixture
def painting_copy(painting_folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(painting_folder, tmp_path / "colour"))


def test_pictures_and_frames_are_read(painting: PaintingInputs) -> None:
    assert len(painting.frames) == 3 and painting.plan.shape == (40, 60, 3)
    assert len(painting.executed.strokes) == 3 and painting.palette_srgb.shape == (2, 3)


def test_missing_file_is_named(painting_copy: Path) -> None:
    (painting_copy / "deviation.json").unlink()
    with pytest.raises(ContractError, match=r"deviation\.json cannot be read .*make repro"):
        read_painting("colour", painting_copy)


def test_missing_picture_is_named(painting_copy: Path) -> None:
    (painting_copy / "plan.png").unlink()
    with pytest.raises(ImageError, match=r"plan\.png"):
        read_painting("colour", painting_copy)


def test_missing_entry_and_invalid_json_are_errors(painting_copy: Path) -> None:
    (painting_copy / "curve.json").write_text(json.dumps({"iteration": []}))
    with pytest.raises(ContractError, match=r"'objective'.* run the stage paint again"):
        read_painting("colour", painting_copy)
    (painting_copy / "curve.json").write_text("{")
    with pytest.raises(ContractError, match=r"curve\.json is not JSON"):
        read_painting("colour", painting_copy)


def test_painting_without_photographs_is_refused(painting_copy: Path) -> None:
    shutil.rmtree(painting_copy / "frames")
    with pytest.raises(ContractError, match="holds no photograph"):
        read_painting("colour", painting_copy)


def plain(html: str) -> str:
    return re.sub(r"<[^>]*>", "", html).replace("\N{NO-BREAK SPACE}", " ")


def section(painting: PaintingInputs) -> str:
    return plain(painting_section(painting, 100, Album()))


def test_summary_has_counts_gain_and_sim2real_factor(painting: PaintingInputs) -> None:
    text = plain(summary(painting))
    assert "the round brush and 2 paints, the robot executed 3 strokes. After every 2 strokes" in text
    assert "lowered the final error by 20 %" in text and "2.50 times smaller than that" in text


def test_section_states_deviation_target_and_planning(painting: PaintingInputs) -> None:
    text = section(painting)
    assert "ended farther from the first plan than the one without, at 0.0200" in text
    assert "tones that the tool’s ink can reach" in text
    assert "from 0.200 to 0.0100 in 2 iterations" in text


def test_words_follow_results_of_the_opposite_sign(worse: Callable[[], PaintingInputs]) -> None:
    painting = worse()
    assert "raised the final error by 25 %" in plain(summary(painting))
    text = section(replace(painting, target=painting.photograph))
    assert "2.00 times larger than the polyline" in text and "25 % of that of a blank canvas" in text
    assert "ended closer to the first plan than" in text and "the photograph itself" in text


def test_equal_results_are_stated_as_equal(painting: PaintingInputs) -> None:
    text = section(replace(painting, deviation_with=painting.deviation_without, sim2real_factor=1.0))
    assert "ended as close to the first plan as" in text and "as large as the polyline" in text
