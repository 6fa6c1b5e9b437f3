"""The stage paint refuses numbers that make no painting, in the words of params.yaml."""

from pathlib import Path
from shutil import copy

import pytest

from pentimento.contracts.errors import ConfigError
from pipelines._config import load_section
from pipelines._imports import ROOT
from pipelines.paint import Paint


@pytest.mark.parametrize(
    ("section", "old", "new", "sentence"),
    [
        ("paint", "strokes: 340", "strokes: 0", r"paint: strokes is 0; it must be 1 or more"),
        ("paint", "replan_every: 20", "replan_every: -1", r"paint: replan_every is -1; it must be 1 or more"),
        ("paint", "darkest: 0.35", "darkest: 1.0", r"paint\.settings\.marker: darkest is 1\.0; it must be below 1"),
        ("planners", "size: 12", "size: 0", r"paint\.settings\.colour\.planner\.palette: size is 0; it must be 1"),
    ],
)
def test_a_number_out_of_its_range_is_one_sentence(
    tmp_path: Path, section: str, old: str, new: str, sentence: str
) -> None:
    params = tmp_path / "params.yaml"
    copy(ROOT / "params.yaml", params)
    load_section(params, "paint", Paint)
    text = params.read_text()
    start = text.index(f"\n{section}:")
    params.write_text(text[:start] + text[start:].replace(old, new, 1))
    with pytest.raises(ConfigError, match=sentence):
        load_section(params, "paint", Paint)
