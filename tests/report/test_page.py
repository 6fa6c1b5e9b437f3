import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from pentimento.report.benchmarks import BenchmarkInputs
from pentimento.report.diagnoses import DiagnosisInputs
from pentimento.report.duet import read_duet
from pentimento.report.handwriting import read_handwriting
from pentimento.report.page import ReportConfig, ReportInputs, build_report
from pentimento.report.paintings import PaintingInputs
from pentimento.report.performances import read_performances
from pentimento.report.plans import read_painting_plan
from pentimento.report.sculpting import read_sculpture
from pentimento.report.tools import ToolInputs
from tests.report.conftest import PICTURES

CONFIG = ReportConfig(frame_ms=100, note=None, strokes=PICTURES)
VOID = {"meta", "img", "source", "br"}


@pytest.fixture(scope="module")
def inputs(painting: PaintingInputs, tool: ToolInputs, benchmarks: BenchmarkInputs) -> ReportInputs:
    return ReportInputs([painting], [tool], benchmarks)


@pytest.fixture(scope="module")
def files(inputs: ReportInputs) -> dict[str, bytes]:
    return build_report(inputs, CONFIG)


@pytest.fixture(scope="module")
def page(files: dict[str, bytes]) -> str:
    return files["index.html"].decode()


class Reader(HTMLParser):
    """Collects tags and attributes, and checks that tags are closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    reader.close()
    return reader


def without_pictures(page: str) -> str:
    return re.sub(r"base64,[A-Za-z0-9+/=]*", "", page)


def test_tags_are_balanced_and_links_have_targets(page: str, files: dict[str, bytes]) -> None:
    reader = read(page)
    assert reader.open == []
    ids = {attrs["id"] for _, attrs in reader.tags if "id" in attrs}
    for tag, attrs in reader.tags:
        target = attrs.get("href")
        if tag == "a" and target is not None and target != "../timings/index.html":
            assert target.removeprefix("#") in ids if target.startswith("#") else target in files


def test_page_is_self_contained(page: str) -> None:
    for tag, attrs in read(page).tags:
        assert tag not in ("script", "link")
        for name in ("src", "srcset"):
            assert attrs.get(name, "data:").startswith(("data:", "../timings/index.html"))  # type: ignore[union-attr]
    assert "http" not in without_pictures(page) and "url(" not in page


def test_every_picture_has_an_alt_text_and_a_file(page: str, files: dict[str, bytes]) -> None:
    pictures = [attrs for tag, attrs in read(page).tags if tag == "img"]
    assert len(pictures) >= 15 and all(len(attrs["alt"] or "") > 10 for attrs in pictures)
    assert {"colour_timelapse.gif", "colour_plan.svg", "colour_sim2real.png", "renderer_time.png"} <= set(files)
    assert files["colour_plan.svg"] == b"<svg/>"


def test_equal_inputs_give_equal_bytes(inputs: ReportInputs, files: dict[str, bytes]) -> None:
    assert build_report(inputs, CONFIG) == files


def test_optional_sections_are_on_the_page_and_linked_only_with_inputs(
    inputs: ReportInputs, page: str, tmp_path: Path
) -> None:
    from tests.report.test_diagnoses import VERDICT
    from tests.report.test_duet import write as write_duet
    from tests.report.test_handwriting import write as write_handwriting
    from tests.report.test_performances import write as write_performance
    from tests.report.test_sculpting import write as write_sculpture

    write_sculpture(tmp_path)
    sculpture = read_sculpture("foam", tmp_path, tmp_path / "metrics_of_model", tmp_path / "gap")
    performances = tmp_path / "performances"
    performances.mkdir()
    (performances / "metrics.json").write_text(json.dumps({"hut": write_performance(performances, "hut", "a hut")}))
    (performances / "sculptures.json").write_text("{}")
    full = replace(
        inputs,
        duet=read_duet(write_duet(tmp_path / "duet")),
        diagnoses=[DiagnosisInputs("round_brush", VERDICT, {})],
        handwriting=read_handwriting(*write_handwriting(tmp_path / "hands")),
        sculptures=[sculpture],
        performances=read_performances(performances),
    )
    with_all = build_report(full, CONFIG)["index.html"].decode()
    assert read(with_all).open == []
    for target in ("duet", "gap", "hands", "sculpting-foam", "runner"):
        for text in (f'<a href="#{target}">', f'<section id="{target}">'):
            assert text in with_all and text not in page


def test_recorded_tools_without_a_painting_open_the_page(inputs: ReportInputs, tmp_path: Path) -> None:
    from tests.report.test_diagnoses import VERDICT
    from tests.report.test_plans import write as write_plan

    found = [DiagnosisInputs("round_brush", VERDICT, {}, recorded=True)]
    plans = [read_painting_plan("round_brush", write_plan(tmp_path))]
    recorded = replace(inputs, paintings=[], benchmarks=None, diagnoses=found, plans=plans)
    page = build_report(recorded, CONFIG)["index.html"].decode()
    reader = read(page)
    assert reader.open == []
    ids = {attrs["id"] for _, attrs in reader.tags if "id" in attrs}
    links = {str(attrs["href"]) for tag, attrs in reader.tags if tag == "a" and str(attrs["href"]).startswith("#")}
    assert {link.removeprefix("#") for link in links} <= ids
    assert {"#recorded", "#plan-round_brush"} <= links and "#gap" not in links and "#speed" not in links
    assert page.index('id="recorded"') < page.index('id="plan-round_brush"') < page.index('id="tools"')


def test_a_note_stands_at_the_top(inputs: ReportInputs, page: str) -> None:
    noted = build_report(inputs, replace(CONFIG, note="A quick run & no more."))["index.html"].decode()
    assert noted.index("<h1>") < noted.index("A quick run &amp; no more.") < noted.index('class="lead"')
    assert 'class="note"' not in page


def test_page_has_no_dates_paths_or_run_ids(page: str) -> None:
    assert not re.search(r"20\d\d-\d\d|\b[0-9a-f]{32}\b|/tmp|/home|/work", without_pictures(page))


def test_frame_duration_below_20_ms_is_refused() -> None:
    with pytest.raises(ValueError, match="frame_ms"):
        ReportConfig(frame_ms=5, note=None, strokes=PICTURES)
