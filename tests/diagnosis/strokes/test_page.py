"""The page: balanced, self-contained, and honest where little is known."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.page import leaderboard
from pentimento.diagnosis.strokes.model import UnevenEnds
from pentimento.diagnosis.strokes.next_actions import Proposal
from pentimento.diagnosis.strokes.report import build_page
from pentimento.diagnosis.verdict import Finding, verdict
from tests.diagnosis.strokes.conftest import Written
from tests.report.test_page import read, without_pictures


@pytest.fixture(scope="module")
def files(written: Written) -> dict[str, bytes]:
    """The page and its pictures as they were written."""
    figures = {f"figures/{file.name}": file.read_bytes() for file in (written.folder / "figures").iterdir()}
    return figures | {"report.html": (written.folder / "report.html").read_bytes()}


def test_tags_are_balanced_and_nothing_is_loaded(files: dict[str, bytes]) -> None:
    page = files["report.html"].decode()
    reader = read(page)
    assert reader.open == []
    for tag, attrs in reader.tags:
        assert tag not in ("script", "link") and (attrs.get("src") or "data:").startswith("data:")
        assert tag != "img" or len(attrs["alt"] or "") > 10
    assert "http" not in without_pictures(page)


def test_it_says_the_sentence_and_what_was_left_out(written: Written, files: dict[str, bytes]) -> None:
    page = files["report.html"].decode()
    assert page.count("Row 56 (counted from 0) is an exact copy") == 1
    assert verdict(written.diagnosis, 56, 42)["sentence"].split(".")[0] in page


def test_every_figure_stands_beside_the_page(files: dict[str, bytes]) -> None:
    page = files["report.html"].decode()
    assert page.count("<img") == len(files) - 1 >= 7
    assert all(
        name.startswith("figures/") and data.startswith(b"\x89PNG")
        for name, data in files.items()
        if name != "report.html"
    )


def test_no_paths_dates_or_leftovers(files: dict[str, bytes]) -> None:
    page = without_pictures(files["report.html"].decode())
    assert not re.search(
        r"20\d\d-\d\d|/tmp|/home|/work|\bnan\b|None|\{", re.sub(r"<style>.*?</style>", "", page, flags=re.S)
    )


def test_every_cause_is_on_the_leaderboard_once(written: Written) -> None:
    rows = re.findall(r'<th scope="row">(?:<b>)?(\w+)', leaderboard(written.diagnosis, written.survey))
    seen = set(written.survey.aliasing.causes) | set(written.diagnosis.search.not_observable)
    assert sorted(rows) == sorted(seen - {UnevenEnds.cause})  # they are the base's


def test_findings_open_the_leaderboard_with_their_numbers(written: Written) -> None:
    found = Finding("bristle_lag", 0.001, 0.001, 0.4, (0.2, 0.6), {"distance_m": (-0.004, 0.001)}, ("latency",))
    html = leaderboard(replace(written.diagnosis, established=(found,), suspected=()), written.survey)
    first = html.split("<tbody>")[1].split("</tr>")[0]
    assert "bristle_lag" in first and "40&nbsp;%" in first and "−0.00400" in first and "latency" in first


def test_where_little_is_known_the_page_says_so(written: Written) -> None:
    """No covariate varies and nothing is in question."""
    bare = written.survey._replace(
        covariates=(), base_strength=np.zeros((7, 0)), extended_strength=np.zeros((7, 0)), dependence=()
    )
    made = verdict(written.diagnosis, 56, 42)
    page = build_page(written.diagnosis, bare, Proposal((), (), {}), made)
    said = page["report.html"].decode()
    assert "cannot be asked" in said and "nothing to measure better" in said
    assert not {"figures/modes.png", "figures/next_actions.png"} & set(page)
