import re
from html.parser import HTMLParser

import pytest

from pentimento.report.benchmarks import BenchmarkInputs
from pentimento.report.inputs import PaintingInputs, ToolInputs
from pentimento.report.page import ReportConfig, build_report
from tests.report.conftest import PICTURES

CONFIG = ReportConfig(frame_ms=100, strokes=PICTURES)
VOID = {"meta", "img", "source", "br"}


@pytest.fixture(scope="module")
def files(painting: PaintingInputs, tool: ToolInputs, benchmarks: BenchmarkInputs) -> dict[str, bytes]:
    return build_report([painting], [tool], benchmarks, CONFIG)


@pytest.fixture(scope="module")
def page(files: dict[str, bytes]) -> str:
    return files["index.html"].decode()


class Reader(HTMLParser):
    """Collects tags and ids, and checks that every tag is closed in its turn."""

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


def test_tags_are_balanced_and_links_lead_somewhere(page: str, files: dict[str, bytes]) -> None:
    reader = read(page)
    assert reader.open == []
    ids = {attrs["id"] for _, attrs in reader.tags if "id" in attrs}
    for tag, attrs in reader.tags:
        target = attrs.get("href")
        if tag == "a" and target is not None and target != "../timings/index.html":
            assert target.removeprefix("#") in ids if target.startswith("#") else target in files


def test_the_page_needs_nothing_else(page: str) -> None:
    for tag, attrs in read(page).tags:
        assert tag not in ("script", "link")
        for name in ("src", "srcset"):
            assert attrs.get(name, "data:").startswith(("data:", "../timings/index.html"))  # type: ignore[union-attr]
    assert "http" not in without_pictures(page) and "url(" not in page


def test_every_picture_has_a_text_and_stands_beside_the_page(page: str, files: dict[str, bytes]) -> None:
    pictures = [attrs for tag, attrs in read(page).tags if tag == "img"]
    assert len(pictures) >= 15 and all(len(attrs["alt"] or "") > 10 for attrs in pictures)
    assert {"colour_timelapse.gif", "colour_plan.svg", "colour_sim2real.png", "renderer_time.png"} <= set(files)
    assert files["colour_plan.svg"] == b"<svg/>"


def test_equal_inputs_give_equal_bytes(
    painting: PaintingInputs, tool: ToolInputs, benchmarks: BenchmarkInputs, files: dict[str, bytes]
) -> None:
    assert build_report([painting], [tool], benchmarks, CONFIG) == files


def test_the_page_holds_no_dates_paths_or_run_ids(page: str) -> None:
    assert not re.search(r"20\d\d-\d\d|\b[0-9a-f]{32}\b|/tmp|/home|/work", without_pictures(page))


def test_a_frame_that_browsers_would_slow_down_is_refused() -> None:
    with pytest.raises(ValueError, match="frame_ms"):
        ReportConfig(frame_ms=5, strokes=PICTURES)
