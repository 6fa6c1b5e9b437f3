"""The page of a diagnosis is valid, self-contained, and states what is unknown."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pentimento.diagnosis.page import cause_rows
from pentimento.diagnosis.strokes.model import UnevenEnds
from pentimento.diagnosis.strokes.next_actions import Proposal
from pentimento.diagnosis.strokes.report import build_page
from pentimento.diagnosis.verdict import verdict
from tests.diagnosis.strokes.conftest import FOUND, Written
from tests.report.test_page import read, without_pictures


@pytest.fixture(scope="module")
def files(written: Written) -> dict[str, bytes]:
    """The page and its pictures as they were written."""
    figures = {f"figures/{file.name}": file.read_bytes() for file in (written.folder / "figures").iterdir()}
    return figures | {"report.html": (written.folder / "report.html").read_bytes()}


def test_page_is_valid_and_loads_nothing(files: dict[str, bytes]) -> None:
    page = files["report.html"].decode()
    reader = read(page)
    assert reader.open == []
    for tag, attrs in reader.tags:
        assert tag not in ("script", "link") and (attrs.get("src") or "data:").startswith("data:")
        assert tag != "img" or len(attrs["alt"] or "") > 10
    assert "http" not in without_pictures(page)


def test_page_contains_the_verdict_and_left_out_rows(written: Written, files: dict[str, bytes]) -> None:
    page = files["report.html"].decode()
    assert page.count("Row 56 (counted from 0) is an exact copy") == 1
    assert verdict(written.result)["text"].splitlines()[0] in page


def test_every_figure_is_also_a_file(files: dict[str, bytes]) -> None:
    page = files["report.html"].decode()
    assert page.count("<img") == len(files) - 1 >= 7
    assert all(
        name.startswith("figures/") and data.startswith(b"\x89PNG")
        for name, data in files.items()
        if name != "report.html"
    )


def test_page_has_no_paths_dates_or_placeholders(files: dict[str, bytes]) -> None:
    page = without_pictures(files["report.html"].decode())
    assert not re.search(
        r"20\d\d-\d\d|/tmp|/home|/work|\bnan\b|None|\{", re.sub(r"<style>.*?</style>", "", page, flags=re.S)
    )


def test_table_lists_every_cause_once(written: Written, files: dict[str, bytes]) -> None:
    rows = [row.name for row in cause_rows(written.result, written.screening)]
    observable = set(written.screening.aliasing.causes) - {UnevenEnds.cause}  # uneven ends belong to the base
    assert sorted(rows) == sorted(observable | set(written.result.known.unobservable))
    table = files["report.html"].decode().split("<tbody>")[1].split("</tbody>")[0]
    assert re.findall(r'<th scope="row">(?:<b>)?(\w+)', table) == rows


def test_table_starts_with_findings(written: Written) -> None:
    negative = replace(FOUND, values={"distance_m": (-0.004, 0.001)})
    rows = cause_rows(replace(written.result, established=(negative,), suspected=(FOUND,)), written.screening)
    assert [(row.name, row.verdict) for row in rows[:2]] == [
        ("bristle_lag", "established"), ("bristle_lag", "suspected"),
    ]  # fmt: skip
    assert (rows[0].gain, rows[0].probability, rows[0].p) == ("41\u00a0%", "0.97", "")
    assert rows[0].quantities == ["distance\u00a0−4\u00a0±\u00a01\u00a0mm"] and rows[0].rivals == ("latency",)
    assert rows[2].verdict == rows[2].probability == "" and rows[2].p != ""


def test_page_states_missing_covariates_and_questions(written: Written) -> None:
    """No covariate varies and nothing is in question."""
    nothing = np.zeros((7, 0))
    bare = replace(written.screening, covariates=(), base_strength=nothing, extended_strength=nothing, dependence=())
    page = build_page(written.result, bare, Proposal((), (), {}), verdict(written.result))
    html = page["report.html"].decode()
    assert "cannot be tested" in html and "no standard error needs to decrease" in html
    assert not {"figures/modes.png", "figures/next_actions.png"} & set(page)
