"""`make docs`: every page of the documentation and the reference, with all its links."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pipelines._imports import ROOT


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it: a link that leads nowhere and a page that no menu has are errors."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)]
    built = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def test_the_first_page_is_the_readme_and_leads_to_the_others(site: Path) -> None:
    page = (site / "index.html").read_text()
    assert "Quick start" in page and 'href="new_brush/"' in page and 'href="contributing/"' in page
    assert (site / "made.jpg").is_file()


def test_the_reference_has_each_parameter_of_each_stage(site: Path) -> None:
    text = (site / "reference" / "params" / "index.html").read_text()
    sections = re.findall(r"^(\w+):", (ROOT / "params.yaml").read_text(), re.MULTILINE)
    stages = [name for name in sections if (ROOT / "pipelines" / f"{name}.py").is_file()]
    assert len(stages) > 15
    assert [name for name in stages if f'id="{name}"' not in text] == []
    assert "By tool, a measured table in the strokes contract" in text


def test_no_page_loads_anything_from_another_computer(site: Path) -> None:
    loading = re.compile(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=[\"']?(https?://[^\"' >]+)")
    found = {url for page in site.rglob("*.html") for url in loading.findall(page.read_text())}
    assert found == set()
