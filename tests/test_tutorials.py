"""The tutorials: each runs from its file alone, and the site shows what it prints and draws."""

import re
from pathlib import Path

import numpy as np
import pytest

from docs.site import tutorials
from pentimento.contracts.images import read_image
from pipelines._imports import ROOT

each = pytest.mark.parametrize("name", tutorials.names())
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
_TOLERANCE = 0.1
"""Of figures: another processor rounds differently."""


@pytest.mark.timeout(400)
@each
def test_it_runs_and_the_site_shows_what_it_prints(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    result, picture = tutorials.run(name)
    kept = tutorials.kept(name)
    assert result["figure"] == pytest.approx(kept["figure"], abs=_TOLERANCE)
    assert [_NUMBER.sub("#", text) for text in result["printed"]] == [
        _NUMBER.sub("#", text) for text in kept["printed"]
    ]
    shown = read_image(tutorials.OUTPUTS / f"{name}.png")
    assert picture.dtype == np.uint8 and picture.shape == shown.shape and picture.std() > 0
    assert np.abs(picture.astype(float) - shown).mean() < 255 * _TOLERANCE


@each
def test_it_states_a_figure_explains_a_picture_and_uses_the_package_alone(name: str) -> None:
    cells = tutorials.cells(name)
    code = "\n".join(cell.text for cell in cells if cell.is_code)
    words = [cell.text for cell in cells if not cell.is_code]
    assert re.search(r"print\(f.*\{figure", code) and "picture" in words[-1] and "picture =" in cells[-1].text
    assert not re.search(r"\b(?:pipelines|studies|tests|benchmarks)\b", code)
    assert not re.search(r"[\s.(]_\w", code), "a private name"
    assert words[0].startswith("# ") and len(cells) >= 6


def test_there_are_five_and_the_site_has_a_page_of_each() -> None:
    assert [name[2:] for name in tutorials.names()] == ["reproduce", "new_brush", "diagnose", "copaint", "sculpt"]
    for name in tutorials.names():
        page = tutorials.page(name)
        assert page.count("```python") == sum(cell.is_code for cell in tutorials.cells(name)) and "```text" in page
        (picture,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", page)
        assert (Path(tutorials.TUTORIALS) / picture).is_file()
