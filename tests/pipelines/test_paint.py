"""The stage paint refuses numbers that make no painting, in the words of params.yaml."""

from pathlib import Path
from shutil import copy

import pytest

from pentimento.contracts.errors import ConfigError
from pipelines._config import load_section
from pipelines._imports import ROOT
from pipelines.paint import Paint


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("strokes: 340", "strokes: 0", r"paint: strokes is 0; it must be 1 or more"),
        ("batch: 20", "batch: -1", r"paint: batch is -1; it must be 1 or more"),
        ("darkest: 0.35", "darkest: 1.0", r"paint\.settings\.marker: darkest is 1\.0; below 1"),
        ("size: 12", "size: 0", r"paint\.settings\.colour\.planner\.palette: size is 0; it must be 1"),
    ],
)
def test_a_number_out_of_its_range_is_one_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    params = tmp_path / "params.yaml"
    copy(ROOT / "params.yaml", params)
    load_section(params, "paint", Paint)
    text = params.read_text()
    section = text.index("\npaint:")
    params.write_text(text[:section] + text[section:].replace(old, new, 1))
    with pytest.raises(ConfigError, match=sentence):
        load_section(params, "paint", Paint)
